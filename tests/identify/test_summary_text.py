"""The terminal output of a fit is short, marks doubtful values, and refers to the full report."""

from types import SimpleNamespace
from typing import Any

import pytest

from baqueano.contracts.result import wrap_sentences
from baqueano.diagnostics import Severity, note
from baqueano.identify import identify
from baqueano.identify.result.fit_result import row_remarks, verdict_lines
from baqueano.messages import group_sentences

MOST = 15  # lines in addition to the tables of parameters and channels


def row(
    estimate: float | None, std: float | None, bound: str | None = None, identifiable: str = "yes"
) -> dict[str, Any]:
    return {"estimate": estimate, "std": std, "bound": bound, "identifiable": identifiable, "start": 0.0}


@pytest.mark.parametrize(
    ("of", "mark"),
    [
        (row(9.67, 110.0), "may be 0"),
        (row(-1.0, 0.52), "may be 0"),
        (row(-1.0, 0.50), "roughly, ± 98 %"),
        (row(1.0, 0.26), "roughly, ± 51 %"),
        (row(1.0, 0.25), ""),
        (row(0.0, 0.1, "low"), "at its lower bound, may be 0"),
        (row(3.0, 1.0, None, "poorly"), "poorly identified, roughly, ± 65 %"),
        (row(3.0, None), "its error is unknown"),
        (row(None, None, None, "no"), "not identifiable, fixed at 0"),
    ],
)
def test_a_row_whose_interval_includes_zero_is_marked(of, mark):
    assert row_remarks(of) == mark


def test_the_table_marks_every_row_that_may_be_zero(case_run, case):
    fit = identify(case_run(0, 4.0), case)
    table = " ".join(fit.table().split())
    doubtful = [row["name"] for row in fit.rows() if row["std"] and abs(row["estimate"]) < 1.96 * row["std"]]
    assert doubtful
    for name in doubtful:
        row = table.partition(f" {name.removeprefix('model.')} ")[2]
        assert row.partition("± ")[2].partition("± ")[0].count("may be 0)") == 1


def lines_of(
    reasons: list[str], unobservable: list[str], unseen: list[str], notes: list[str], verdict: str = "WARN",
    with_report: bool = False,
) -> list[str]:  # fmt: skip
    """Return the lines of codes without a template, which are printed unchanged."""
    fields = {"reasons": reasons, "unobservable": unobservable, "always_unobservable": unseen, "notes": notes}
    by_field = {name: tuple(map(note, codes)) for name, codes in fields.items()}
    return verdict_lines(SimpleNamespace(verdict=verdict, **by_field), with_report)


WORDS = ("one", "two", "three", "four", "five", "six", "seven", "eight")


def test_long_verdicts_fit_a_screen_and_count_the_omitted_lines():
    lines = lines_of(*([f"{kind}.{word}" for word in WORDS] for kind in ("a", "b", "c", "d")))
    assert len(lines) <= MOST
    shown_count = sum(line.startswith("- ") for line in lines)
    assert (
        lines[-1]
        == f'and {4 * len(WORDS) - shown_count} more: bq.report(fit, "fit.html") shows all, with figures'
    )


def test_the_last_line_refers_to_the_report_for_omitted_notes():
    words = list(WORDS)
    on_request, in_report = (
        lines_of(words, [], [], [], with_report=with_report) for with_report in (False, True)
    )
    assert on_request[:-1] == in_report[:-1]
    assert on_request[-1] == 'and 3 more: bq.report(fit, "fit.html") shows all, with figures'
    assert in_report[-1] == "and 3 more: the report shows all, with figures"
    assert lines_of(["one"], [], [], [], with_report=True) == ["WARN: one"]


def autocorrelated_note(i: int, **words: str):
    return note("any.autocorrelated", Severity.WARNING, subject=f"imu[{i}]", percent=i + 2.5, **words)


def test_the_same_note_of_several_channels_is_printed_once():
    first = "any.autocorrelated (percent = 2.5)"
    assert group_sentences([autocorrelated_note(i) for i in range(3)]) == [f"{first} (also imu[1], imu[2])"]
    assert group_sentences([autocorrelated_note(0), autocorrelated_note(0)]) == [f"{first} (2 times)"]
    assert group_sentences([autocorrelated_note(0, of_run="a"), autocorrelated_note(0, of_run="b")]) == [
        f"a: {first} (2 times)"
    ]


def test_notes_with_different_texts_are_printed_separately():
    differ = [autocorrelated_note(0, needs="turns"), autocorrelated_note(1, needs="speed")]
    assert len(group_sentences(differ)) == len(group_sentences([note("any.one"), note("any.other")])) == 2


def test_a_single_reason_is_printed_on_the_line_of_the_verdict():
    assert lines_of(["converged"], [], [], ["a-note"], "USABLE") == ["USABLE: converged", "- a-note"]


def test_the_verdict_of_a_short_run_fits_a_screen(case_run, case):
    fit = identify(case_run(0, 2.0), case)
    assert fit.verdict != "USABLE"
    lines = verdict_lines(fit)
    assert len(lines) <= MOST
    wrapped_lines = wrap_sentences(lines)
    assert fit.table().endswith("\n".join(wrapped_lines))
    assert all(len(line) <= 80 or "baqueano " in line for line in wrapped_lines)
    assert (
        len(fit.reasons) + len(fit.unobservable) + len(fit.always_unobservable) + len(fit.notes)
        >= len(lines) - 2
    )
