"""A short print contains whole sentences, and the verdict; a page is not written as a figure."""

import pytest

from baqueano.contracts.result import MAX_LINES, Result, shorten
from baqueano.errors import UsageError
from baqueano.report.page import Page
from baqueano.vehicle_file import load
from tests.codes import refused


def test_a_long_line_is_wrapped_and_never_cut():
    sentence = "a long word " * 12
    assert shorten([], [sentence], []).replace("\n ", "").split() == sentence.split()
    short = shorten([sentence], [sentence] * MAX_LINES, ["USABLE", *[sentence] * MAX_LINES]).splitlines()
    assert len(short) <= MAX_LINES
    assert "…" not in "".join(short)
    assert "USABLE" in short


def test_a_sentence_has_at_most_80_letters_and_a_row_of_a_table_stays_whole():
    sentence, row = "a long word " * 8, "name   " + "12.5  " * 13
    assert max(map(len, shorten([], [sentence], []).splitlines())) <= 80
    assert shorten([], [row], []) == row


def test_a_version_of_the_package_is_not_a_command():
    line = "baqueano 0.1.0; " + "python 3.11.7; " * 9
    assert max(map(len, shorten([], [line], []).splitlines())) <= 80


@pytest.mark.parametrize("name", ["small", "car", "case-study-1"])
def test_a_vehicle_is_printed_in_80_columns(name):
    assert max(map(len, repr(load(name)).splitlines())) <= 80


def test_the_verdict_of_a_long_table_is_printed():
    class Long(Result):
        def table(self):
            return "\n".join([*"abcdefghijklmn", "WARN: a reason"])

    assert repr(Long()).splitlines()[-2:] == ["more lines (4): .table()", "WARN: a reason"]


@pytest.mark.parametrize("name", ["page.pdf", "page.SVG"])
def test_a_page_with_the_name_of_a_figure_is_refused(tmp_path, name):
    with refused("front.page-as-figure", UsageError):
        Page("a page", "", "", [], [], "").save(tmp_path / name)
    assert not list(tmp_path.iterdir())
