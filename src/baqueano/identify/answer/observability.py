"""Unobservable parameters (solve/seen.py) in words, and the motion that would show them,
as the fields of the blocks say it (parameter.py).

What the vehicle can never show is said once, and is no reproach to the run.
"""

from collections.abc import Sequence

from baqueano.identify.solve.parameters import Free
from baqueano.vehicles.freedoms import AXES


def weakly(one: Free, near: Sequence[Free]) -> str:
    """Why a parameter has a large error, and what would help."""
    return f"{_inseparable((one, *near), 'has a large error only')}. {_needs(one)}"


def _inseparable(some: Sequence[Free], alone: str) -> str:
    short = [one.short for one in some]
    if len(short) == 1:
        return f"{short[0]} {alone}{_moved(some)}"
    return f"{', '.join(short[:-1])} and {short[-1]} are hardly separable{_moved(some)}"


def _moved(some: Sequence[Free]) -> str:
    """What the vehicle did, that it does not tell these from each other."""
    axes = {one.axis for one in some if one.axis is not None}
    if axes == {1}:
        return ": the vehicle hardly moved sideways"
    frictions = {one.path.partition("[")[0] for one in some if one.axis is not None and one.of.role != "gain"}
    if len(axes) == 1 and len(frictions) > 1:
        return f": it {'went' if axes == {0} else 'turned'} at too few speeds"
    return ""


def sentence(one: Free, ties: Sequence[Free], at: float, near: Sequence[Free] = ()) -> str:
    """Why a held parameter is not known, and what would help."""
    if ties:
        by_hand = one.of.measured_by
        how = f"take it from {by_hand}" if by_hand else "fix one that you know from elsewhere"
        others = ", ".join(t.short for t in ties[:4]) + (" and others" if len(ties) > 4 else "")
        return (
            f"{one.short} cannot be told from {others}: only their combination acts on what is measured; held at "
            f"{at:.4g}: {how}{_apart((one, *ties))}."
        )
    if one.of.role == "scale":
        return (
            f"{one.short} would be known no better than a data sheet tells it, ± 3 %; held at {at:.4g}. "
            f"{_needs(one)}"
        )
    said = _inseparable((one, *near), "does not show in what was measured")
    return f"{said}; {one.short if near else ''}{' ' if near else ''}held at {at:.4g}. {_needs(one)}"


def _apart(some: Sequence[Free]) -> str:
    """The motions that tell them from each other, two at most."""
    found = dict.fromkeys(one.shown_by for one in some if one.shown_by)
    return f", or tell them apart by {' and by '.join(list(found)[:2])}" if found else ""


def missing_command(some: Sequence[Free], command: str, never: bool) -> str:
    """Why a column of T or V is not known."""
    short = ", ".join(one.short for one in some)
    if never:
        said = {"u_y": "the vehicle has no sideways actuator"}.get(
            command, f"the vehicle cannot move {command}"
        )
        return f"{short}: {said}, so this can never be seen and never matters."
    return f"{short}: {command} was 0 all the time. This needs a run in which it moves."


def _needs(one: Free) -> str:
    if one.shown_by:
        return f"This needs {one.shown_by}."
    if one.of.role == "gain" and one.of.shape == (3, 3):
        row, column = (AXES[i] for i in one.entry)
        return f"This needs {column} commands, and {row} motion that comes of them."
    return "This needs a run in which it matters."
