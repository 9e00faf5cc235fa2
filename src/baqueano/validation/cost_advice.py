"""Recommend the cost of a fit by its errors on held-out runs.

    D = Σ_c (ẽ_c² − ê_c²)/n_c² / Σ_c ê_c²/n_c²,   ê by simulation error, ẽ by innovations                 (1)

The sums are over all channels c of all held-out runs; n_c is their noise, (2) of held_out.py.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from baqueano.diagnostics import Severity, Verdict, note
from baqueano.identify.fit import identify
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import PROCESS_NOISE_PATH
from baqueano.identify.result.fit_result import Fit
from baqueano.runs.run import Run
from baqueano.validation.held_out import Validation, validate
from baqueano.vehicle_file import VehicleFile

ADVICE_CODES = ("cost.try-innovations", "cost.innovations", "cost.simulation", "cost.too-short")


def is_fit_by_innovations(fit: Fit) -> bool:
    """Return True if the fit minimised the innovations: then its parameters include the process noise."""
    return any(name.startswith(PROCESS_NOISE_PATH) for name in fit.names)


def with_cost_advice(
    fit: Fit, runs: Sequence[Run], validation: Validation, refit: Callable[[str], Fit]
) -> Fit:
    """Return the fit with a note on the cost that the held-out `runs` recommend. `validation` is the validation of the
    fit on these runs, and `refit(cost)` returns the fit with another cost. The fit is returned unchanged if its notes
    do not compare costs, or if the validation is inconclusive. If the other fit is refused, or has the same cost, the
    note that compares costs is removed."""
    index = next((k for k, message in enumerate(fit.notes) if message.code in ADVICE_CODES), None)
    if index is None or any(message.severity == Severity.UNKNOWN for message in validation.messages):
        return fit
    second_fit = refit("simulation" if is_fit_by_innovations(fit) else "innovations")
    if second_fit.verdict == Verdict.REFUSED or is_fit_by_innovations(second_fit) == is_fit_by_innovations(
        fit
    ):
        return replace(fit, notes=fit.notes[:index] + fit.notes[index + 1 :])
    validations = [validation, validate(second_fit, runs)]
    simulation, innovations = reversed(validations) if is_fit_by_innovations(fit) else validations
    percent = 100.0 * relative_error_change(simulation, innovations)
    advice = note("cost.held-out-smaller" if percent < 0.0 else "cost.held-out-larger", percent=abs(percent))
    if advice.code == "cost.held-out-smaller" and not is_fit_by_innovations(fit):
        advice = note("cost.try-innovations", fix="--cost innovations", cause=advice)
    return replace(fit, notes=(*fit.notes[:index], advice, *fit.notes[index + 1 :]))


def refit_with_cost(
    runs: Sequence[Run], vehicle_file: VehicleFile, *, options: FitOptions, **arguments: Any
) -> Callable[[str], Fit]:
    """Return a function that fits the runs with a given cost, without diagnostics. All other `options` and the
    arguments `arguments` of `identify` are unchanged."""
    return lambda cost: identify(
        runs, vehicle_file, options=replace(options, cost=cost, diagnose=False), **arguments
    )


def relative_error_change(simulation: Validation, innovations: Validation) -> float:
    """Return D, the relative change of the squared error if the innovations replace the simulation error.  (1)"""
    squares = {(f.run, f.channel): f.error**2 for f in innovations.figures}
    pairs = [
        (f.error**2 / f.noise**2, squares[f.run, f.channel] / f.noise**2)
        for f in simulation.figures
        if f.noise > 0.0 and (f.run, f.channel) in squares
    ]
    old_sum, new_sum = np.sum(pairs, axis=0) if pairs else (1.0, 1.0)
    return float(new_sum / old_sum - 1.0)
