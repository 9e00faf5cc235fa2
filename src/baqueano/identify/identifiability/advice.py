"""Describe unobservable parameters (identifiability/identifiable.py), and the motion that would make them observable.

The texts come from the fields of the blocks (parameter.py). An effect that this vehicle can never show is reported
once, because another run would not help.
"""

from collections.abc import Sequence

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.parameters.free import Free
from baqueano.vehicles.freedoms import AXIS_NAMES

MAX_NAMES = 4  # names in one message
WARNING = Severity.WARNING


def weak_reason(parameter: Free, confused: Sequence[Free]) -> Diagnostic:
    """Return the reason for the large error of a parameter, and the motion that would reduce it."""
    if confused:
        names = _names(confused)
        return note(
            "identifiability.weakly-beside",
            WARNING,
            subject=parameter.path,
            others=names,
            why=_motion_note((parameter, *confused)),
            needs=_needed_motion(parameter),
        )
    return note(
        "identifiability.weakly",
        WARNING,
        subject=parameter.path,
        why=_motion_note((parameter,)),
        needs=_needed_motion(parameter),
    )


def unobservable_reason(
    parameter: Free, collinear: Sequence[Free], value: float, confused: Sequence[Free] = ()
) -> Diagnostic:
    """Return the reason why a parameter is fixed at `value`, and the motion that would show it."""
    if collinear:
        return note(
            "identifiability.tied",
            subject=parameter.path,
            others=_names(collinear),
            at=value,
            how=_by_hand(parameter),
            apart=_separation((parameter, *collinear)),
        )
    if parameter.of.role == "scale":
        return note(
            "identifiability.scale", subject=parameter.path, at=value, needs=_needed_motion(parameter)
        )
    reason, needs = _motion_note((parameter, *confused)), _needed_motion(parameter)
    if confused:
        return note(
            "identifiability.not-beside",
            subject=parameter.path,
            others=_names(confused),
            at=value,
            why=reason,
            needs=needs,
        )
    return note("identifiability.not", subject=parameter.path, at=value, why=reason, needs=needs)


def missing_command(parameters: Sequence[Free], command: str, never: bool) -> Diagnostic:
    """Return the reason why the fit does not determine the column of `command` in the gain matrix, T or V."""
    names = _names(parameters)
    if never and command == "u_y":
        return note("identifiability.never-sideways", subject=parameters[0].path, names=names)
    code = "identifiability.never" if never else "identifiability.command-still"
    return note(code, subject=parameters[0].path, names=names, command=command)


def _names(parameters: Sequence[Free]) -> str:
    """Return the short names as text, at most MAX_NAMES."""
    return ", ".join(
        [parameter.short for parameter in parameters[:MAX_NAMES]] + ["…"] * (len(parameters) > MAX_NAMES)
    )


def _motion_note(parameters: Sequence[Free]) -> Diagnostic | str:
    """Return a note on the limited motion that does not separate the `parameters`, or ""."""
    axes = {parameter.axis for parameter in parameters if parameter.axis is not None}
    if axes == {1}:
        return note("identifiability.hardly-sideways")
    frictions = {
        parameter.path.partition("[")[0]
        for parameter in parameters
        if parameter.axis is not None and parameter.of.role != "gain"
    }
    if len(axes) == 1 and len(frictions) > 1:
        return note("identifiability.few-speeds") if axes == {0} else note("identifiability.few-turn-rates")
    return ""


def _by_hand(parameter: Free) -> Diagnostic:
    return (
        note("identifiability.by-hand", by=parameter.of.measured_by)
        if parameter.of.measured_by
        else note("identifiability.fix-one")
    )


def _separation(parameters: Sequence[Free]) -> Diagnostic | str:
    """Return a note with one or two motions that separate the `parameters`, or ""."""
    motions = [*dict.fromkeys(parameter.shown_by for parameter in parameters if parameter.shown_by)][:2]
    if len(motions) == 2:
        return note("identifiability.apart-by-two", first=motions[0], second=motions[1])
    return note("identifiability.apart", motion=motions[0]) if motions else ""


def _needed_motion(parameter: Free) -> Diagnostic:
    if parameter.shown_by:
        return note("identifiability.needs", motion=parameter.shown_by)
    if parameter.of.role == "gain" and parameter.of.shape == (3, 3):
        row, column = (AXIS_NAMES[i] for i in parameter.entry)
        return note("identifiability.needs-command", command=column, motion=row)
    return note("identifiability.needs-run")
