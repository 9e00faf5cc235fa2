"""The lines that a terminal shows of a fit: marks of its table, the verdict, and the first of what is to be said.

A row is marked "may be 0" where 0 lies inside its 95 % interval, and "roughly" where that interval is wider than
the value: |θ̂| < 1.96 σ, |θ̂| < 3.92 σ. Messages that are alike are one line (messages.grouped); a verdict rests on the
first REASONS of them, and of what a run did not show, and of notes, the first few are told. `Fit.findings` and the
report hold the whole.
"""

from typing import Any

from baqueano.diagnostics import Verdict, by_weight, note
from baqueano.identify.covariance.information import QUANTILE_95
from baqueano.messages import grouped, text

REASONS, UNSEEN, NOTES = 5, 3, 4  # lines of each: with the verdict and the word on the others at most 14
MEANS = {Verdict.REFUSED: note("verdict.refused"), Verdict.WARN: note("verdict.warn")}


def marks(row: dict[str, Any]) -> str:
    """What a row of `Fit.rows()` should not be read without, "" for nothing."""
    value, sd = row["estimate"], row["sd"]
    if value is None:
        return "not seen"
    said = [f"at its {row['bound']} bound"] if row["bound"] else []
    said += ["weakly seen"] if row["observable"] == "weak" else []
    if sd is None:
        said.append("its error is not known")
    elif abs(value) < QUANTILE_95 * sd:
        said.append("may be 0")
    elif abs(value) < 2.0 * QUANTILE_95 * sd:
        said.append(f"roughly, ± {100.0 * QUANTILE_95 * sd / abs(value):.0f} %")
    return ", ".join(said)


def verdict_lines(fit: Any, reported: bool = False) -> list[str]:
    """Return the verdict, what it rests on, and what else is good to know; `reported`: the rest is in a report."""
    told = (fit.reasons, fit.unobservable, fit.never + fit.notes)
    reasons, unseen, notes = (grouped(by_weight(one)) for one in told)
    if len(reasons) == 1:
        lines = [f"{fit.verdict}: {reasons[0]}"]
    else:
        lines = [f"{fit.verdict}: {text(MEANS.get(fit.verdict))}"]
        lines += [f"- {one}" for one in reasons[:REASONS]]
    lines += [f"- {one}" for one in (*unseen[:UNSEEN], *notes[:NOTES])]
    more = sum(max(0, len(said) - n) for said, n in ((reasons, REASONS), (unseen, UNSEEN), (notes, NOTES)))
    if not more:
        return lines
    return [*lines, text(note("verdict.more-in-report" if reported else "verdict.more", more=more))]
