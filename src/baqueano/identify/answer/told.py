"""What a terminal shows of a fit: the table, and of all that is to be said what one reads.

A row is marked "may be 0" where 0 lies inside its 95 % interval, and "roughly" where that interval is wider than
the value: |θ̂| < 1.96 σ, |θ̂| < 3.92 σ. Sentences that differ in their channel and figures alone are told once, as
first said; a verdict rests on the first REASONS of them, and of what a run did not show, and of notes, the first
few are told. A sentence longer than LONGEST ends where its first parts end. `Fit.reasons`, `unobservable`, `never`
and `notes` hold the whole, and so does the report.
"""

import re
from collections.abc import Sequence
from typing import Any

from baqueano.contracts.values import TableRow
from baqueano.identify.solve.intervals import QUANTILE_95

REASONS, UNSEEN, NOTES = 5, 3, 4  # lines of each: with the verdict and the word on the others at most 14
LONGEST = 200  # letters of a line
OTHERS = 5  # channels that are named after the first
_LABEL = re.compile(r"[A-Za-z_][\w.]*\[[\d,]+\]")  # imu[2], friction.linear[0]
_NUMBER = re.compile(r"[-−]?\d+(\.\d+)?(e[-+]?\d+)?")


def marks(row: TableRow) -> str:
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
    """The verdict, what it rests on, and what else is good to know; `reported`: the rest is in a report."""
    reasons, unseen, notes = (folded(said) for said in (fit.reasons, fit.unobservable, fit.never + fit.notes))
    if len(reasons) == 1:
        lines = [f"{fit.verdict}: {reasons[0]}"]
    else:
        lines = [f"{fit.verdict}: {MEANS.get(fit.verdict, '')}"]
        lines += [f"- {one}" for one in reasons[:REASONS]]
    lines += [f"- {one}" for one in (*unseen[:UNSEEN], *notes[:NOTES])]
    more = sum(max(0, len(said) - n) for said, n in ((reasons, REASONS), (unseen, UNSEEN), (notes, NOTES)))
    where = "the report" if reported else "--report fit.html"
    return [*lines, f"and {more} more: {where} tells all, with figures"] if more else lines


MEANS = {
    "REFUSED": "the vehicle file stays as it is",
    "WARN": "usable with these doubts",
    "USABLE": "",
}


def folded(said: Sequence[str]) -> list[str]:
    """The sentences, shortened; those that differ in their channel and figures alone are one."""
    alike: dict[str, list[str]] = {}
    for one in said:
        alike.setdefault(_NUMBER.sub("#", _LABEL.sub("@", one)), []).append(one)
    return [_with_others(same) for same in alike.values()]


def _with_others(same: list[str]) -> str:
    first = _LABEL.search(same[0])
    others = [found.group() for one in same[1:] for found in [_LABEL.search(one)] if found]
    others = [one for one in dict.fromkeys(others) if first is None or one != first.group()]
    if others:
        rest = f" and {len(others) - OTHERS} more" if len(others) > OTHERS else ""
        tail = f" (so also {', '.join(others[:OTHERS])}{rest})"
    else:
        tail = f" ({len(same)} times)" if len(same) > 1 else ""
    return brief(same[0], LONGEST - len(tail)) + tail


def brief(text: str, longest: int = LONGEST) -> str:
    """The text, or as many of its first parts as are not longer, and the last where it says what is needed, or what to
    type."""
    if len(text) <= longest:
        return text
    for last in (" This needs ", " Type: "):
        before, what, needs = text.rpartition(last)
        if what and len(what + needs) < longest // 2:
            return brief(before, longest - len(what + needs)) + what + needs
    ends = [found.start() for found in re.finditer(r"[;:.,] ", text) if found.start() <= longest - 2]
    strong = [at for at in ends if text[at] != "," and at > longest // 3]
    return text[: max(strong or ends or [longest - 2])].rstrip(",;:. ") + " …"
