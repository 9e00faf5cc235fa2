"""A short print contains whole sentences, and the verdict; a page is not written as a figure."""

import pytest

from baqueano.contracts.result import MAX_LINES, Result, shorten
from baqueano.errors import UsageError
from baqueano.report.page import Page
from tests.codes import refused


def test_a_long_line_is_wrapped_and_never_cut():
    sentence = "a long word " * 12
    assert shorten([], [sentence], []).replace("\n ", "").split() == sentence.split()
    short = shorten([sentence], [sentence] * MAX_LINES, ["USABLE", *[sentence] * MAX_LINES]).splitlines()
    assert len(short) <= MAX_LINES
    assert "…" not in "".join(short)
    assert "USABLE" in short


def test_the_verdict_of_a_long_table_is_printed():
    class Long(Result):
        def table(self):
            return "\n".join([*"abcdefghijklmn", "WARN: a reason"])

    assert repr(Long()).splitlines()[-2:] == ["4 more lines: .table()", "WARN: a reason"]


@pytest.mark.parametrize("name", ["page.pdf", "page.SVG"])
def test_a_page_with_the_name_of_a_figure_is_refused(tmp_path, name):
    with refused("front.page-as-figure", UsageError):
        Page("a page", "", "", [], [], "").save(tmp_path / name)
    assert not list(tmp_path.iterdir())
