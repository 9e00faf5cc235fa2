"""Does the gyro turn as fast as the others say, or 57.3 times as fast: °/s that were read as rad/s?

    ω_w = (v_r − v_l)/b    of two wheels b apart             ω_z = r ω_w                                   (1)
    a_y = v ω              of a vehicle that does not slide  a_y = v ω_z / r                               (2)
    ω_h = h(θ_0)           of the vehicle file's own numbers ω_z = r ω_h                                   (3)

r by least squares over means of WINDOW_S (or four samples, if that is longer), believed from CLEAR of its standard
errors on. It is 1 where units are right, and 180/π or its inverse where they are not; wheels that skid, a floor that
tilts and a file that was guessed to a factor of two are all nearer to 1 than to that, and a unit is named within
NEAR of it. v of (2) is what odometer or wheels say; its sign does not matter, both sides change it.

A gyro that turns as wheels or the model do is cleared, and nothing else accuses it. (2) alone does not tell a gyro in
another unit from an accelerometer in another unit, or from one that points up, and names both.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.doubts import axes
from baqueano.identify.options import FitOptions
from baqueano.identify.solve.parameters import Free, value
from baqueano.identify.solve.posed import first_theta
from baqueano.identify.solve.problem import Problem
from baqueano.runs.run import Channel, Run
from baqueano.runs.windows import means
from baqueano.signals import NANOSECONDS

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

DEGREES = 180.0 / np.pi
CURVE = "gyro.or-accelerometer"  # the code of a doubt that names two suspects
NEAR = 2.0  # either way: what a data sheet and a scale promise together
WINDOW_S, SAMPLES = 0.2, 4.0
FEW, CLEAR = 20, 5.0  # windows, standard errors
RAN_AWAY = 1e6  # rad/s, of a model


def checked(run: Run, file: "VehicleFile", name: str) -> list[Diagnostic]:
    """A gyro in another unit than wheels, or speed and sideways acceleration, of the same run: nothing where some
    wheels turn as it does, and gyro or accelerometer where a curve alone tells.  (1), (2)"""
    known, turned, curves = file.sensors._asdict(), [], []
    for other, channel in run.sensors.items():
        block = known.get(other)
        wheels = hasattr(block, "track_m")
        if not (wheels or hasattr(block, "scale")) or channel.z.shape[1] != block.size:
            continue
        both = _windows(run.sensors[name], channel)
        if both is None:
            continue
        imu, moved = both
        if wheels:
            turned.append((_ratio(imu[:, 2], (moved[:, 1] - moved[:, 0]) / block.track_m), other))
        curves.append((_ratio(imu[:, 1], moved.mean(axis=1) * imu[:, 2]), other))
    if any(_near(ratio) for ratio, _ in turned):
        return []
    found = [_found(name, ratio, note("gyro.as-wheels", subject=other)) for ratio, other in turned]
    found += [_of_a_curve(name, slope, other) for slope, other in curves]
    return [one for one in found if one is not None][:1]


def _of_a_curve(name: str, slope: float, other: str) -> Diagnostic | None:
    """What a_y = slope · v ω says: which of them is wrong, it does not know.  (2)"""
    ratio = 1.0 / slope if slope else 0.0
    found = _found(name, ratio, note("gyro.as-curve", subject=f"{name}[1]", speed=other))
    if found is None:
        return None
    return note(CURVE, Severity.ERROR, subject=f"{name}[1]", gyro=found, times=abs(slope))


def against_model(end: Any) -> tuple[list[Diagnostic], bool]:
    """A gyro in another unit than the turning that commands make by the numbers of the vehicle file, of a finished
    search (summary.Finished), and whether every gyro is cleared: it turns as they say, or as wheels do, or the fit
    explains it with the file's own gains. Where the search began tells nothing of it.  (1), (3)"""
    problem, sensors = end.task.problem, end.blocks.sensors._asdict()
    told = [end.wanted[k]._replace(low=-np.inf, high=np.inf) for k in end.told]
    by_file, _, _ = first_theta(end.blocks, told, problem.shape, problem.records, FitOptions())
    at = dict(zip(problem.names, np.cumsum([0, *problem.sizes[:-1]]), strict=True))
    by_wheels = [
        [(z[:, at[name] + 1] - z[:, at[name]]) / block.track_m for z in _known(problem)]
        for name, block in sensors.items()
        if name in at and hasattr(block, "track_m")
    ]
    found, cleared = [], True
    for name in (name for name in at if hasattr(sensors[name], "gyro_scale")):
        i = at[name] + 2
        model = _against(problem, i, [h[:, i] for h in problem.predictions(by_file)])
        if not (_near(model) or any(map(_near, _others(end, i, by_wheels)))):
            found, cleared = [*found, _found(name, model, note("gyro.as-commands"))], False
    return [one for one in found if one is not None], cleared


def _others(end: Any, i: int, by_wheels: Sequence[Sequence[np.ndarray]]) -> Iterator[float]:
    """r of the gyro in column i against each sensor of wheels, and against the fit if it has the file's own gains."""
    problem = end.task.problem
    yield from (_against(problem, i, turned) for turned in by_wheels)
    if _as_promised(end):
        yield _against(problem, i, [h[:, i] for h in problem.predictions(end.found.solution.theta)])


def _known(problem: Problem) -> list[np.ndarray]:
    """What was measured (N, m) of each piece, NaN where nothing was."""
    return [np.where(has > 0.0, z, np.nan) for z, has in zip(problem.z, problem.has, strict=True)]


def _against(problem: Problem, i: int, turned: Sequence[np.ndarray]) -> float:
    """r of the gyro in column i over all pieces, each of which `turned` so (N,)."""
    y = np.concatenate(turned)
    return _ratio(
        np.concatenate([z[:, i] for z in _known(problem)]), np.where(np.abs(y) < RAN_AWAY, y, np.nan)
    )


def _as_promised(end: Any) -> bool:
    """True if a fit left the gains that turn the vehicle, and what they act on, near those of the file. A fit in which
    none of its free gains is identifiable says nothing about them."""
    free = end.free
    now, kept = end.found.solution.theta[: len(free)], end.sight.kept[: len(free)]
    was = [value(end.blocks, one.path) if _turns(one) else 0.0 for one in free]
    moved = [x / x_0 for x, x_0, seen in zip(now, was, kept, strict=True) if seen and x_0]
    shown = bool(moved) or not any(was)
    return end.found.solution.converged and shown and all(map(_near, moved))


def _turns(one: Free) -> bool:
    """Return True for a gain or a measure of the vehicle from which its turning comes."""
    is_gain = one.of.role in ("gain", "known") and one.path.startswith("model.")
    return is_gain and one.axis in (None, 2) and not one.unit.startswith("m/s")


def _near(ratio: float) -> bool:
    return 1.0 / NEAR < abs(ratio) < NEAR


def _found(name: str, ratio: float, who: Diagnostic) -> Diagnostic | None:
    size = abs(ratio)
    for factor, unit, read in ((DEGREES, "deg/s", "rad/s"), (1.0 / DEGREES, "rad/s", "deg/s")):
        if factor / NEAR < size < factor * NEAR:
            units = {"given": unit, "read": read}
            return note("gyro.unit", Severity.ERROR, subject=f"{name}[2]", times=size, by=who, **units)
    return None


def _ratio(z: np.ndarray, of: np.ndarray) -> float:
    """r of z = r · of, both without their means; 0 where it is not clear."""
    good = np.isfinite(z) & np.isfinite(of)
    if good.sum() < FEW:
        return 0.0
    x, y = (axes.clipped(v[good]) for v in (of, z))
    x, y = x - x.mean(), y - y.mean()
    power = float(x @ x)
    if power <= 1e-12 * len(x):
        return 0.0
    r = float(x @ y) / power
    sd = float(np.sqrt(np.sum((y - r * x) ** 2) / (len(x) - 2) / power))
    return r if abs(r) > CLEAR * sd else 0.0


def _windows(one: Channel, other: Channel) -> tuple[np.ndarray, np.ndarray] | None:
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
