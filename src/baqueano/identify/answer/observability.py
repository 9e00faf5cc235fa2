"""What the data cannot show (solve/seen.py) in words: the parameters, and the motion that is missing.

What the vehicle can never show is said once, and is no reproach to the run.
"""

from collections.abc import Sequence

from baqueano.identify.solve.parameters import Free
from baqueano.identify.solve.seen import MEASURABLE, SCALES

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
