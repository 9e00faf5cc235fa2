"""Recommend one of two costs from held-out runs, which were not used in either fit.

    D = Σ_c (ẽ_c² − ê_c²)/n_c² / Σ_c ê_c²/n_c²                                                            (1)

The sums are over the channels c of held-out runs. The open-loop error of a channel is ê for the fit of the simulation
error, and ẽ for the fit of the innovations. n is the noise in ê (validation.py). If D is below 0, the innovations are
recommended. Without held-out runs, or if they have too few segments of motion, segments of the fitted runs decide
(objective_choice.py).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.identify.fit import identify
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import FLOOR
from baqueano.identify.result.fit_result import Fit
from baqueano.identify.validation import Validation, validate
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

OPEN = ("cost.try-innovations", "cost.innovations", "cost.simulation", "cost.too-short")


def by_innovations(fit: Fit) -> bool:
    """Return True if the fit minimised the innovations: then its parameters include the process noise."""
    return any(name.startswith(FLOOR) for name in fit.names)


def with_cost_advice(
    fit: Fit, runs: Sequence[Run], validation: Validation, refit: Callable[[str], Fit]
) -> Fit:
    """Return the fit with a note on the cost that the held-out `runs` recommend.

    `validation` is the validation of the fit on these runs, and `refit(cost)` returns the fit with another cost. The
    fit is returned unchanged if its notes do not compare costs, or if the validation is inconclusive. If the other
    fit is refused, or has the same cost, the note that compares costs is removed.
    """
    at = next((k for k, message in enumerate(fit.notes) if message.code in OPEN), None)
    if at is None or any(message.severity == Severity.UNKNOWN for message in validation.messages):
        return fit
    other = refit("simulation" if by_innovations(fit) else "innovations")
    if other.verdict == Verdict.REFUSED or by_innovations(other) == by_innovations(fit):
        return replace(fit, notes=fit.notes[:at] + fit.notes[at + 1 :])
    both = [validation, validate(other, runs)]
    simulation, innovations = reversed(both) if by_innovations(fit) else both
    advice = _advice(100.0 * more_error(simulation, innovations))
    if advice.code == "cost.held-out-smaller" and not by_innovations(fit):
        advice = note("cost.try-innovations", fix="--cost innovations", cause=advice)
    return replace(fit, notes=(*fit.notes[:at], advice, *fit.notes[at + 1 :]))


def by_other_cost(
    runs: Sequence[Run], vehicle_file: "VehicleFile", *, options: FitOptions, **how: Any
) -> Callable[[str], Fit]:
    """Return a function that fits the runs with a given cost, without diagnostics.

    All other `options` and the arguments `how` of `identify` are unchanged.
    """
    return lambda cost: identify(
        runs, vehicle_file, options=replace(options, cost=cost, diagnose=False), **how
    )


def more_error(simulation: Validation, innovations: Validation) -> float:
    """Return D, the relative change of the squared error if the innovations replace the simulation error.  (1)"""
    squares = {(f.run, f.channel): f.error**2 for f in innovations.figures}
    pairs = [
        (f.error**2 / f.noise**2, squares[f.run, f.channel] / f.noise**2)
        for f in simulation.figures
        if f.noise > 0.0 and (f.run, f.channel) in squares
    ]
    before, after = np.sum(pairs, axis=0) if pairs else (1.0, 1.0)
    return float(after / before - 1.0)


def _advice(percent: float) -> Diagnostic:
    code = "cost.held-out-smaller" if percent < 0.0 else "cost.held-out-larger"
    return note(code, percent=abs(percent))
