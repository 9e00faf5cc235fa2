"""Use the logged voltage V of the battery if the runs show its effect κ on the motors: (4) of drivetrain.py.

    V_95 − V_5 > 0.03 V_50,   percentiles of V while a command is sent                                    (1)
    κ > 3 σ_κ,   2 · 1.96 σ_κ ≤ 1,   0 ≤ κ ≤ V₀/(V₀ − V_d) within its error                               (2)

If (1) holds, a second fit with a free κ is the test. If (2) holds too, it replaces the fit without κ, in which a
battery that becomes empty looks like friction. Motors at V − V_d behind a bridge have κ = V₀/(V₀ − V_d) > 1; (2) has
the largest V_d of a data sheet, at most V₀/2. If the file does not state a voltage, V_50 becomes its voltage and its
nominal voltage: then the gains are valid for the mean battery of the runs, as without κ.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import Diagnostic, Verdict, note
from baqueano.identify.data.added_channels import BATTERY_CHANNEL, VOLTAGE_RATIO_RANGE
from baqueano.identify.parameters.free import BATTERY_EFFECT
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.identify.result.fit_result import Fit
    from baqueano.vehicle_file import VehicleFile

MIN_CHANGE = 0.03  # a regulated supply changes less
MIN_SIGMA = 3.0
MAX_DROP_V = 3.2  # V_d of the L298 at 1 A, both transistors together
VOLTAGE_KEYS = ("battery_v", "battery_nominal_v")


def separation_problem(value: float, std: float, nominal_v: float) -> Diagnostic | None:
    """Return the reason why κ = `value` is not the effect of the battery alone, or None.  (2)"""
    half_width, maximum = QUANTILE_95 * std, nominal_v / max(nominal_v - MAX_DROP_V, 0.5 * nominal_v)
    if 2.0 * half_width > 1.0:
        return note("term.battery-not-separable", value=value, half_width=half_width)
    if -half_width <= value <= maximum + half_width:
        return None
    return note("term.battery-outside", value=value, half_width=half_width, maximum=maximum)


def with_shown_battery(
    fit: "Fit", runs: Sequence[Run], file: "VehicleFile", fixed: Sequence[str],
    refit: "Callable[[VehicleFile, str], Fit]",
) -> "Fit":  # fmt: skip
    """Return the fit with a free κ if the runs show κ, else `fit` with a note. Without (1) return `fit`.

    `fixed` contains the paths to keep. `refit` returns the fit of another file with a further free path.
    """
    drivetrain = getattr(file.vehicle, "drivetrain", None)
    volts = _drive_voltages(runs)
    if (
        not len(volts) or fit.verdict == Verdict.REFUSED
        or drivetrain is None or not has_field(drivetrain, "battery_effect")
        or drivetrain.battery == "logged" or BATTERY_EFFECT in (*fit.names, *fixed)
    ):  # fmt: skip
        return fit
    low, median, high = np.percentile(volts, (5, 50, 95)).tolist()
    if not high - low > MIN_CHANGE * median:
        return fit
    keys = file.data.get("model", {}).get("drivetrain", {})
    if not any(key in keys for key in VOLTAGE_KEYS):
        file = file.with_values({f"model.drivetrain.{key}": round(median, 3) for key in VOLTAGE_KEYS})
    nominal_v = file.vehicle.drivetrain.battery_nominal_v
    if not VOLTAGE_RATIO_RANGE[0] < median / nominal_v < VOLTAGE_RATIO_RANGE[1]:
        voltage_note = note("battery.other-voltage", run=runs[0].name, voltage_v=median, nominal_v=nominal_v)
        return replace(fit, notes=(voltage_note, *fit.notes))
    extended_fit = refit(file, BATTERY_EFFECT)
    k = extended_fit.names.index(BATTERY_EFFECT)
    value, std = float(extended_fit.estimate[k]), float(extended_fit.std[k])
    figures = {"low_v": low, "high_v": high, "value": value, "half_width": QUANTILE_95 * std}
    if not value > MIN_SIGMA * std:
        reason_unused = note("battery.not-shown", **figures)
    elif (reason := separation_problem(value, std, nominal_v)) is None:
        return replace(extended_fit, notes=(note("battery.shown", **figures), *extended_fit.notes))
    else:
        reason_unused = note("battery.not-used", **figures, reason=reason)
    return replace(fit, notes=(reason_unused, *fit.notes))


def _drive_voltages(runs: Sequence[Run]) -> np.ndarray:
    """Return all logged voltages (K,) [V] while a command is sent."""
    volts = [np.zeros(0)]
    for run in (run for run in runs if BATTERY_CHANNEL in run.sensors):
        channel = run.sensors[BATTERY_CHANNEL]
        rows = np.clip(np.searchsorted(run.t_ns, channel.t_ns), 0, len(run.t_ns) - 1)
        is_driven = np.any(np.nan_to_num(run.applied_commands)[rows] != 0.0, axis=1)
        z = channel.z[is_driven, 0]
        volts.append(z[np.isfinite(z)])
    return np.concatenate(volts)
