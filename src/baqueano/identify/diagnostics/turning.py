"""Does the gyro turn as fast as the others say, or 57.3 times as fast: °/s that were read as rad/s?

    ω_w = (v_r − v_l)/b    of two wheels b apart             ω_z = r ω_w                                   (1)
    a_y = v ω              of a vehicle that does not slide  a_y = v ω_z / r                               (2)
    ω_h = h(θ_0)           of the vehicle file's own numbers ω_z = r ω_h                                   (3)

Each is a signal map (runs/diagnostics/signal_map.py): of means over WINDOW_S or four samples, (3) of samples. r is 1
where units are right, and 180/π or its inverse where they are not; wheels that skid, a floor that tilts and a file that
was guessed to a factor of two are all nearer to 1 than to that, and a unit is named within NEAR of it. v of (2) is what
odometer or wheels say; its sign does not matter, both sides change it.

A gyro that turns as wheels or the model do is cleared, and nothing else accuses it. (2) alone does not tell a gyro in
another unit from an accelerometer in another unit, or from one that points up, and names both.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.diagnostics import axes
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import Free, value
from baqueano.identify.parameters.setup import first_theta
from baqueano.runs.diagnostics.signal_map import NOTHING, Hypothesis, MappedChannel, signal_map
from baqueano.runs.run import Channel as Log
from baqueano.runs.run import Run
from baqueano.runs.windows import means
from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.identify.identifiability.identifiable import FinishedFit
    from baqueano.vehicle_file import VehicleFile

CURVE = "gyro.or-accelerometer"  # the code of a doubt that names two suspects
NEAR = 2.0  # either way: what a data sheet and a scale promise together
WINDOW_S, SAMPLES = 0.2, 4.0
FEW = 20  # rows
TOO_FAST = {np.degrees(1.0): "deg/s", np.radians(1.0): "rad/s"}  # what the gyro is in, by r
TOO_SLOW = {1.0 / r: unit for r, unit in TOO_FAST.items()}  # and by 1/r


def checked(run: Run, file: "VehicleFile", name: str) -> list[Diagnostic]:
    """A gyro in another unit than wheels, or speed and sideways acceleration, of the same run: nothing where some
    wheels turn as it does, and gyro or accelerometer where a curve alone tells.  (1), (2)"""
    known, turned, curves = file.sensors._asdict(), [], []
    for other, channel in run.sensors.items():
        block: Tree = known.get(other)
        wheels = has_field(block, "track_m")
        if not (wheels or has_field(block, "scale")) or channel.z.shape[1] != block.size:
            continue
        if (both := _windows(run.sensors[name], channel)) is None:
            continue
        imu, moved = both
        if wheels:
            turned.append((_map(imu[:, 2], (moved[:, 1] - moved[:, 0]) / block.track_m, TOO_FAST), other))
        curves.append((_map(imu[:, 1], moved.mean(axis=1) * imu[:, 2], TOO_SLOW), other))
    if any(_near(one) for one, _ in turned):
        return []
    found = [
        _found(name, one, abs(one.relation.slope), note("gyro.as-wheels", subject=other))
        for one, other in turned
    ]
    found += [_of_a_curve(name, one, other) for one, other in curves]
    return [one for one in found if one is not None][:1]


def _of_a_curve(name: str, curve: Hypothesis, other: str) -> Diagnostic | None:
    """What a_y = v ω_z / r says: which of them is wrong, it does not know.  (2)"""
    slope = abs(curve.relation.slope) or np.nan
    found = _found(name, curve, 1.0 / slope, note("gyro.as-curve", subject=f"{name}[1]", speed=other))
    if found is None:
        return None
    return note(CURVE, Severity.ERROR, subject=f"{name}[1]", gyro=found, times=slope)


def against_model(end: "FinishedFit") -> tuple[list[Diagnostic], bool]:
    """A gyro in another unit than the turning that commands make by the numbers of the vehicle file, of a finished
    search, and whether every gyro is cleared: it turns as they say, or as wheels do, or the fit
    explains it with the file's own gains. Where the search began tells nothing of it.  (1), (3)"""
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    told = [end.wanted[k]._replace(low=-np.inf, high=np.inf) for k in end.told]
    by_file, _, _ = first_theta(end.blocks, told, problem.shape, problem.records, FitOptions())
    at = dict(zip(problem.names, np.cumsum([0, *problem.sizes[:-1]]), strict=True))
    z, h = axes.measured(problem), axes.predicted(problem, by_file)
    wheels = [(k, sensors[name]) for name, k in at.items() if has_field(sensors[name], "track_m")]
    turned = [(z[:, k + 1] - z[:, k]) / block.track_m for k, block in wheels]
    fitted = [axes.predicted(problem, end.found.solution.theta)] if _as_promised(end) else []
    found, cleared = [], True
    for name in (name for name in at if has_field(sensors[name], "gyro_scale")):
        i = at[name] + 2
        of = h[:, i], *turned, *(fit[:, i] for fit in fitted)
        model, *others = (_map(z[:, i], omega, TOO_FAST) for omega in of)
        if not any(map(_near, (model, *others))):
            slope, cleared = abs(model.relation.slope), False
            found.append(_found(name, model, slope, note("gyro.as-commands")))
    return [one for one in found if one is not None], cleared


def _as_promised(end: "FinishedFit") -> bool:
    """True if a fit left the gains that turn the vehicle, and what they act on, near those of the file. A fit in which
    none of its free gains is identifiable says nothing about them."""
    free = end.free
    now, kept = end.found.solution.theta[: len(free)], end.sight.kept[: len(free)]
    was = [value(end.blocks, one.path) if _turns(one) else 0.0 for one in free]
    moved = [x / x_0 for x, x_0, seen in zip(now, was, kept, strict=True) if seen and x_0]
    shown = bool(moved) or not any(was)
    return end.found.solution.converged and shown and all(1.0 / NEAR < abs(ratio) < NEAR for ratio in moved)


def _turns(one: Free) -> bool:
    """Return True for a gain or a measure of the vehicle from which its turning comes."""
    is_gain = one.of.role in ("gain", "known") and one.path.startswith("model.")
    return is_gain and one.axis in (None, 2) and not one.unit.startswith("m/s")


def _map(z: np.ndarray, h: np.ndarray, units: dict[float, str]) -> Hypothesis:
    """What z (N,) shows of h (N,)."""
    z, h = (axes.clipped(x[:, None]) for x in (z, h))
    return signal_map(z, h, [MappedChannel(1.0 / NEAR, NEAR, units)], NOTHING)[0]


def _near(one: Hypothesis) -> bool:
    return one.is_clear and one.ratio == 1.0


def _found(name: str, one: Hypothesis, r: float, who: Diagnostic) -> Diagnostic | None:
    if not one.meaning:
        return None
    units = {"given": one.meaning, "read": "rad/s" if one.meaning == "deg/s" else "deg/s"}
    return note("gyro.unit", Severity.ERROR, subject=f"{name}[2]", times=r, by=who, **units)


def _windows(one: Log, other: Log) -> tuple[np.ndarray, np.ndarray] | None:
    """Means (W, m) of both over the same windows, those in which both said something."""
    if min(len(one.t_ns), len(other.t_ns)) < FEW:
        return None
    usual_s = max(float(np.median(np.diff(c.t_ns))) for c in (one, other)) / NANOSECONDS
    width = max(WINDOW_S, SAMPLES * usual_s)
    origin = int(min(one.t_ns[0], other.t_ns[0]))
    both = [means(c, origin, width) for c in (one, other)]
    same = np.intersect1d(both[0][0], both[1][0])
    first, second = (mean[np.searchsorted(windows, same)] for windows, mean in both)
    return first, second
