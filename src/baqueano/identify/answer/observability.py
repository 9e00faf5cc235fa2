"""What the data cannot show, found in the information matrix and said in words.

    C_ij = A_ij / √(A_ii A_jj)                   information in units of each parameter's own effect      (1)
    s_i  = √((E_c − 30) / A_ii^c)                the change of θ_i that is as large as a signal itself    (2)

A_ii^c is the information of channel c on θ_i, c the channel that has most of it, and E_c the energy of what
the model says there, both in standard deviations of the noise; 30 is what a fit to noise alone may have. A
direction v with C v ≈ 0 moves parameters without moving any measurement: only the others are told, and one
of the direction's parameters is held where it was, by preference one that scale or tape can measure. A
parameter of the vehicle whose standard error exceeds `BLIND` s_i is held too: nothing that was measured
depends on it. So is one with an error of half the span of its bounds, and a scale that would be known no better
than by its data sheet, `TOLERANCE`. One with an error above `WEAK_VALUE` of its own value and `WEAK_SIGNAL` of (2)
is kept and called weak.
Which others it could be mistaken for is told by the direction v_j of C that has most of its variance,
Σ_j v_ij²/λ_j: parameters with `LOADING` of its largest entry or more.
The sentences name them and the motion that is missing. What the vehicle can never show is said once, and is no
reproach to the run.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.identify.answer.intervals import Information, covariance_of
from baqueano.identify.solve.parameters import Free

SINGULAR = 1e-9  # eigenvalue of C below which a direction is not seen
BLIND = 0.5
NOISE_ENERGY = 30.0  # that a model without any motion may take from the noise, 5 σ of one number
TOLERANCE = 0.03 / 3.0**0.5  # σ of a scale that a data sheet tells to ± 3 %, as that of an MPU-6050
SCALES = (
    "gyro_scale",
    "accel_scale[0]",
    "accel_scale[1]",
    "radius_scale[0]",
    "radius_scale[1]",
    "odometer.scale",
)
WEAK_VALUE = 0.3
WEAK_SIGNAL = 0.02
LOADING = 0.3  # part of the largest entry of a direction, above which a parameter belongs to it

MEASURABLE = {
    "mass_kg": "the scale",
    "inertia_kg_m2": "½ m R²",
    "wheelbase_m": "the tape",
    "track_m": "the tape",
    "lever_arm_m[0]": "the tape",
    "lever_arm_m[1]": "the tape",
    "tilt_rad[0]": "a level",
    "tilt_rad[1]": "a level",
    "gyro_scale": "two turns on its mark, measured by hand",
}
# end of a path → what would show it
MISSING = {
    "friction.linear[0]": "driving forward and back, and coasting",
    "friction.linear[1]": "sliding sideways, as in fast tight turns",
    "friction.linear[2]": "turning, and coasting out of the turn",
    "friction.quadratic[0]": "driving forward both slowly and at full speed",
    "friction.quadratic[1]": "sliding sideways both a little and fast, as in turns of many speeds",
    "friction.quadratic[2]": "turning both slowly and at full rate",
    "friction.coulomb[0]": "driving slowly and stopping, many times",
    "friction.coulomb[1]": "sliding sideways slowly",
    "friction.coulomb[2]": "turning slowly and stopping, many times",
    "friction.cornering": "turning at speed",
    "coulomb_forward[0]": "the left wheel rolling forward slowly, and stopping, many times",
    "coulomb_forward[1]": "the right wheel rolling forward slowly, and stopping, many times",
    "coulomb_backward[0]": "the left wheel rolling backward slowly, and stopping, many times",
    "coulomb_backward[1]": "the right wheel rolling backward slowly, and stopping, many times",
    "dead_zone_forward[0]": "forward commands just above the dead zone of the first motor",
    "dead_zone_forward[1]": "forward commands just above the dead zone of the second motor",
    "dead_zone_backward[0]": "backward commands just above the dead zone of the first motor",
    "dead_zone_backward[1]": "backward commands just above the dead zone of the second motor",
    "drivetrain.limit[0]": "commands beyond what the first motor can do",
    "drivetrain.limit[1]": "commands beyond what the second motor can do",
    "drivetrain.sag": "small commands and the largest ones",
    "battery_effect": "a voltage that changes: runs with a full and with an empty battery",
    "centre_of_mass_x_m": "hard changes of turning, and turning fast",
    "lag_s": "sudden changes of the command",
    "delay_s": "sudden changes of the command",
    "cornering_drag": "turning at speed",
    "coulomb_m_s2": "driving slowly and stopping, many times",
    "motor_drag": "the same speed with much throttle and with none: steps up, and coasting down",
    "slide_s": "turning at speed, seen by a camera",
    "quadratic_drag": "driving both slowly and at full speed",
    "linear_drag": "driving and coasting",
    "throttle_gain": "changes of the throttle",
    "steering_gain": "steering to both sides while driving",
    "steering_offset_rad": "driving straight for a while",
    "yaw_lag_s": "sudden changes of steering while driving",
    "gyro_scale": 'turns whose angle is known: turn it twice on its mark, and add --measured "end: 720 deg"',
    "lever_arm_m[0]": "turning fast",
    "lever_arm_m[1]": "hard changes of turning",
    "tilt_rad[0]": "a bias that is known: fix accel_bias with the mean of two rests, turned around between",
    "tilt_rad[1]": "a bias that is known: fix accel_bias with the mean of two rests, turned around between",
    "imu.heading_rad": "hard starts and stops straight ahead",
    "radius_scale[0]": "a distance that is known, by tape or camera",
    "radius_scale[1]": "a distance that is known, by tape or camera",
    "odometer.scale": "a distance that is known, by tape or camera",
    "track_m": "turns whose angle is known",
    "accel_scale[0]": "a known slope, or a speed from wheels or a camera",
    "accel_scale[1]": "a known slope, or a speed from wheels or a camera",
}  # fmt: skip


class Seen(NamedTuple):
    """What can be told, and what cannot."""

    kept: np.ndarray  # (p,) bool: entries of θ that were told
    weak: np.ndarray  # (p,) bool: told, but hardly
    tied: dict[int, tuple[int, ...]]  # a held entry → the entries that it cannot be told from
    near: dict[int, tuple[int, ...]] = {}  # noqa: RUF012  a weak or held entry → those it is hardly told from


def seen(
    info: Information,
    energy: np.ndarray,
    theta: np.ndarray,
    names: Sequence[str],
    held: np.ndarray,
    span: np.ndarray | None = None,
) -> Seen:
    """Which entries of θ (p,) the data show; `held` (p,) bool are out of the question already, `span` (p,) is
    how far apart their bounds are."""
    kept, tied, near = ~held & (np.diagonal(info.bread) > 0.0), {}, {}
    signal = _signal_scale(info.channels, energy)
    while kept.any():
        direction = _unseen_direction(info.bread, kept)
        if direction is None:
            break
        inside = np.flatnonzero(np.abs(direction) >= LOADING * np.max(np.abs(direction))).tolist()
        out = max(inside, key=lambda i, v=direction: (names[i].rpartition(".")[2] in MEASURABLE, abs(v[i])))
        tied[out] = tuple(i for i in inside if i != out)
        kept[out] = False
    of_vehicle = np.array([name.startswith(("model.", "sensors.")) for name in names])
    signal = signal if span is None else np.minimum(signal, span)
    scales = np.array([name.endswith(SCALES) for name in names])
    signal = np.where(scales, np.minimum(signal, TOLERANCE / BLIND), signal)
    weak = np.zeros(len(theta), bool)
    while kept.any():
        index = np.flatnonzero(kept)
        sd = np.sqrt(np.diagonal(covariance_of(info, index)))
        excess = np.where(of_vehicle[index], sd - BLIND * signal[index], -1.0)
        if not np.any(excess > 0.0):
            large = (sd > WEAK_VALUE * np.abs(theta[index])) & (sd > WEAK_SIGNAL * signal[index])
            weak[index] = large & of_vehicle[index]
            near |= {int(k): _like(info.bread, kept & of_vehicle, int(k)) for k in np.flatnonzero(weak)}
            break
        relative = sd / np.maximum(signal[index], 1e-9 * sd)
        out = int(index[np.argmax(np.where(excess > 0.0, relative, -1.0))])
        near[out] = _like(info.bread, kept & of_vehicle, out)
        kept[out] = False
    return Seen(kept, weak, tied, near)


def _like(A: np.ndarray, kept: np.ndarray, k: int) -> tuple[int, ...]:
    """The other entries of the direction in which most of the variance of entry k lies."""
    index = np.flatnonzero(kept)
    root = 1.0 / np.sqrt(np.diagonal(A)[index])
    values, vectors = np.linalg.eigh(A[np.ix_(index, index)] * np.outer(root, root))
    row = vectors[int(np.searchsorted(index, k))]
    v = np.abs(vectors[:, np.argmax(row**2 / np.maximum(values, 1e-12 * values[-1]))])
    return tuple(int(i) for i in index[v >= LOADING * v.max()] if i != k)


def weakly(path: str, near: Sequence[str]) -> str:
    """Why a parameter has a large error, and what would help."""
    return f"{_inseparable(path, near, 'has a large error only')}. {_needs(path)}"


def _inseparable(path: str, near: Sequence[str], alone: str) -> str:
    short = [p.removeprefix("model.") for p in (path, *near)]
    if not near:
        return f"{short[0]} {alone}{_moved((path,))}"
    return f"{', '.join(short[:-1])} and {short[-1]} are hardly separable{_moved((path, *near))}"


def _moved(paths: Sequence[str]) -> str:
    """What the vehicle did, that it does not tell these from each other."""
    axes = {axis for path in paths for axis in [_axis(path)] if axis is not None}
    if axes == {1}:
        return ": the vehicle hardly moved sideways"
    frictions = {path.rpartition(".")[2].partition("[")[0] for path in paths}
    if len(axes) == 1 and {"linear", "quadratic"} <= frictions:
        return f": it {'went' if axes == {0} else 'turned'} at too few speeds"
    return ""


def _axis(path: str) -> int | None:
    """0 forward, 1 sideways, 2 turning."""
    entry = path.rpartition("[")[2].rstrip("]").split(",")[0]
    return int(entry) if ("friction" in path or "matrix" in path) and entry.isdigit() else None


def sentence(one: Free, ties: Sequence[str], at: float, near: Sequence[str] = ()) -> str:
    """Why a held parameter is not known, and what would help."""
    short = one.path.removeprefix("model.")
    if ties:
        key = one.path.rpartition(".")[2]
        how = (
            f"take it from {MEASURABLE[key]}" if key in MEASURABLE else "fix one with what is known otherwise"
        )
        others = ", ".join(t.removeprefix("model.") for t in ties[:4]) + (
            " and others" if len(ties) > 4 else ""
        )
        return (
            f"{short} cannot be told from {others}: only their combination acts on what is measured; held at "
            f"{at:.4g}: {how}{_apart((one.path, *ties))}."
        )
    if one.path.endswith(SCALES):
        return (
            f"{short} would be known no better than a data sheet tells it, ± 3 %; held at {at:.4g}. "
            f"{_needs(one.path)}"
        )
    said = _inseparable(one.path, near, "does not show in what was measured")
    return f"{said}; {short if near else ''}{' ' if near else ''}held at {at:.4g}. {_needs(one.path)}"


def _apart(paths: Sequence[str]) -> str:
    """The motions that tell them from each other, two at most."""
    found = [motion for path in paths for end, motion in MISSING.items() if path.endswith(end)]
    return f", or tell them apart by {' and by '.join(list(dict.fromkeys(found))[:2])}" if found else ""


def missing_command(one: Sequence[str], command: str, never: bool) -> str:
    """Why a column of T or V is not known."""
    short = ", ".join(path.removeprefix("model.") for path in one)
    if never:
        said = {"u_y": "the vehicle has no sideways actuator"}.get(
            command, f"the vehicle cannot move {command}"
        )
        return f"{short}: {said}, so this can never be seen and never matters."
    return f"{short}: {command} was 0 all the time. This needs a run in which it moves."


def _needs(path: str) -> str:
    for end, motion in MISSING.items():
        if path.endswith(end):
            return f"This needs {motion}."
    if "matrix[" in path:
        row, column = (int(i) for i in path.rpartition("[")[2].rstrip("]").split(","))
        entry = ("forward", "sideways", "turning")
        return f"This needs {entry[column]} commands, and {entry[row]} motion that comes of them."
    return "This needs a run in which it matters."


def _unseen_direction(A: np.ndarray, kept: np.ndarray) -> np.ndarray | None:
    """v (p,) with C v ≈ 0 among the entries `kept`, or None.  (1)"""
    index = np.flatnonzero(kept)
    root = 1.0 / np.sqrt(np.diagonal(A)[index])
    values, vectors = np.linalg.eigh(A[np.ix_(index, index)] * np.outer(root, root))
    if values[0] > SINGULAR * values[-1]:
        return None
    v = np.zeros(len(A))
    v[index] = vectors[:, 0]
    return v


def _signal_scale(channels: np.ndarray, energy: np.ndarray) -> np.ndarray:
    """s (p,).  (2)"""
    most = np.argmax(channels, axis=0)
    info = channels[most, np.arange(channels.shape[1])]
    return np.sqrt(np.maximum(energy[most] - NOISE_ENERGY, 0.0) / np.maximum(info, 1e-300))
