"""Describe the free parameters of a fit: paths of a vehicle file, with bounds and units.

A free parameter has the path of its entry, such as "model.actuator_matrix[0,2]"; a path without an entry means all
entries. Unit and bounds come from the field of the block; friction is never negative (errata 6). The role of a field
(parameter.py) decides if it is free by default: what the equations need and scale and tape cannot measure. Dry
friction, dead zones and lag are free by default only if the file has them. The drag of cornering is also free if no
command pushes the vehicle sideways: an IMU shows the speed only in turns, so without it the straight drive would have
the speed of the turns. A gain of 0 along an axis that no command drives stays fixed, and the mount of a sensor is free
in its place (`_mounts`). A delay has the value in the file; a free delay is searched tick by tick (delay.py). A free
value that is off in the file (a lag of 0, a limit of infinity) starts at a value with an effect (`enable_parameters`).
Columns of a matrix whose command never moved cannot be identified: `fixed_columns` returns them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from baqueano.calibration.tolerances import entry_paths
from baqueano.contracts import optional
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, nearest, note
from baqueano.errors import UsageError
from baqueano.estimators.readings.sensor_numbers import GENERAL_MOTION, PARAMETER_STEP
from baqueano.identify.data.record import FittedBlocks
from baqueano.parameter import TERM_ROLES, Parameter, Words, all_parameters, parameters
from baqueano.runs.run import Run
from baqueano.signals import Motion
from baqueano.symbolic import value_at_path, with_value, with_values
from baqueano.vehicles.freedoms import (
    AXIS_NAMES,
    coasting_axes,
    damping_derivatives,
    decay_rates,
    quadratic_damping,
)
from baqueano.vehicles.rk4 import row_rate_hz

FREE_ROLES = ("free", "gain", "offset")  # roles of fields that are free by default
SIDEWAYS = 1  # axis
MIN_BACKWARD_NS = 1e9  # duration of drive backward, for the parameters with the role "reverse"
MAX_TURN_RAD = 0.35  # of a mount by hand; a larger one exchanges axes, and is named as a wrong mount
Channels = Mapping[str, Sequence[int]]
NO_CHANNELS: Channels = {}  # all sensors are used with all their channels
PROCESS_NOISE_PATH = "model.process_noise_std"  # process noise of ν
DELAY_PATH = "model.drivetrain.delay_s"
LAG_PATH, SERVO_LAG_PATH = "model.drivetrain.lag_s", "model.drivetrain.servo_lag_s"
BACK_EMF_PATH = "model.drivetrain.back_emf_share"
LIMIT_PATH = "model.drivetrain.limit"
BATTERY_EFFECT = "model.drivetrain.battery_effect"
WHEEL_FRICTIONS = ("model.friction.coulomb_forward", "model.friction.coulomb_backward")
MAX_DELAY_S = 0.25  # upper bound of a delay, if the file's delay is shorter and the user states no bound
LAG_START_TICKS, MIN_LAG = 5.0, 0.1  # ticks: start of the search for a lag, and its lower bound
LOW_PASS, MAX_LOW_PASS_RATIO = ".low_pass_hz", 5.0  # times the tick rate: almost without effect
LIMIT_START = 0.7  # of the largest command: start of the search for the limit of a motor
# of a friction, per tick: above 1.6 the steps of RK4 decay slower again, above 2.8 they grow
MAX_DECAY_PER_ROW = 1.5
MAX_INERTIAL_M_S2 = 3.0  # ν_x ν_ψ, the acceleration along an axis that no command drives
ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth")


class FreeParameter(NamedTuple):
    """A free parameter of a fit: one value of the vehicle file, with its unit and its bounds."""

    path: str  # with its entry
    unit: str
    low: float
    high: float
    definition: Parameter  # description of its field
    entry: tuple[int, ...]
    is_numerical_bound: bool = False  # True if the integrator sets the upper bound, and the equations cannot

    @property
    def short_name(self) -> str:
        """Return the path in its short form for people."""
        return self.path.removeprefix("model.")

    @property
    def axis(self) -> int | None:
        """Return the axis along which the parameter acts: 0 forward, 1 sideways, 2 turning, or None if undefined."""
        return self.entry[0] if self.entry and self.definition.axes else None

    @property
    def column(self) -> int | None:
        """Return the index of the command if the parameter is a gain, else None."""
        return self.entry[-1] if self.entry and self.definition.role == "gain" else None

    @property
    def shown_by(self) -> str:
        """Return the motion that shows the parameter, or "" if it is not documented."""
        return entry_text(self.definition.shown_by, self.entry)

    @property
    def label(self) -> str:
        """Return the parameter's short name for people, or "" if it is undefined or off the diagonal of a matrix."""
        diagonal = len(set(self.entry)) <= 1
        return entry_text(self.definition.label, self.entry) if diagonal else ""


def entry_text(words: Words, entry: tuple[int, ...]) -> str:
    """Return the text of one entry, with {nth} and {axis} replaced by words."""
    if not entry:
        return words if isinstance(words, str) else words[0]
    first = entry[0]
    text = words if isinstance(words, str) else words[min(first, len(words) - 1)]
    nth = ORDINALS[first] if first < len(ORDINALS) else f"{first + 1}th"
    return text.replace("{nth}", nth).replace("{axis}", AXIS_NAMES[min(first, 2)])


def default_free(
    blocks: FittedBlocks, channels: Channels = NO_CHANNELS, runs: Sequence[Run] = ()
) -> list[str]:
    """Return the paths, with entries, that are free by default. `channels` are those of partly used sensors. A
    parameter with the role "reverse" is free only if the `runs` drive backward for more than MIN_BACKWARD_NS."""
    backward_ns = sum(np.sum(np.diff(run.t_ns)[run.applied_commands[:-1, 0] < 0.0]) for run in runs)
    roles = [role for role in TERM_ROLES if role != "reverse" or backward_ns > MIN_BACKWARD_NS]
    fields = list(all_parameters(blocks.model, "model"))
    field_paths = [path for path, p in fields if p.role in FREE_ROLES and path != PROCESS_NOISE_PATH]
    paths = [p for path in field_paths for p in entries(blocks, path) if not _is_undriven(blocks, p)]
    for path, p in fields:
        terms = entries(blocks, path) if p.role in roles else []
        is_needed = p.role == "rolling" and _has_no_sideslip(blocks)
        paths += [entry for entry in terms if is_needed or value(blocks, entry) != p.neutral]
    return paths + _mounts(blocks, channels)


def _has_no_sideslip(blocks: FittedBlocks) -> bool:
    """Return True for a dynamic model that no command pushes sideways."""
    return optional.is_dynamic(blocks.model) and SIDEWAYS not in driven_axes(blocks)


def _is_undriven(blocks: FittedBlocks, path: str) -> bool:
    """Return True for a force of 0 along an axis on which no command acts, such as a sideways force of two wheels."""
    parameter = free_parameter(blocks, path, {})
    is_gain = parameter.column is not None and parameter.axis is not None
    return is_gain and parameter.axis not in driven_axes(blocks) and value(blocks, path) == 0.0


def _mounts(blocks: FittedBlocks, channels: Channels) -> list[str]:
    """Return the paths of the mounts of the sensors. A straight acceleration of a vehicle that no command pushes
    sideways shows how its accelerometers are turned; otherwise a turned sensor and such a push look the same."""
    if not _has_no_sideslip(blocks):
        return []
    motion, paths = Motion(GENERAL_MOTION[:3], GENERAL_MOTION[3:6], GENERAL_MOTION[6:], np.zeros(2)), []
    for name, sensor in blocks.sensors._asdict().items():
        rows = list(channels.get(name, range(sensor.size)))
        for path, _ in (p for p in parameters(sensor) if p[1].role == "mount"):
            changed_sensor = with_value(sensor, path, value_at_path(sensor, path) + PARAMETER_STEP)
            has_effect = np.any((changed_sensor.h(motion) != sensor.h(motion))[rows])
            paths += [f"sensors.{name}.{path}"] if has_effect else []
    return paths


def driven_axes(blocks: FittedBlocks) -> tuple[int, ...]:
    """Return the axes along which a command acts: 0 forward, 1 sideways, 2 turning. If another row of the file's gain
    matrix has a gain, a row of zeros also states that no command acts along its axis."""
    axes = optional.attribute(getattr(blocks.model, "drivetrain", None), "driven_axes")
    for path, p in all_parameters(blocks.model, "model"):
        if p.role == "gain" and p.shape == (3, 3):
            has_gain = np.any(_value_at(blocks, path) != 0.0, axis=1)
            axes = tuple(i for i in axes if has_gain[i] or not has_gain.any())
    return axes


def has_offset(model: Tree) -> bool:
    """Return True if the model has an offset, such as a steering offset: a gyro's bias has the same effect."""
    return any(p.role == "offset" for _, p in all_parameters(model, "model"))


def entries(blocks: FittedBlocks, path: str) -> list[str]:
    """Return the path of each entry of the field `path`, such as "model.actuator_matrix[0,2]"."""
    return entry_paths(path, _value_at(blocks, path).shape)


def value(blocks: FittedBlocks, path: str) -> float:
    """Return the value of the parameter at `path`."""
    return float(_value_at(blocks, path))


def free_parameter(
    blocks: FittedBlocks, path: str, bounds: Mapping[str, tuple[float, float]]
) -> FreeParameter:
    """Return the free parameter at `path`, with its unit; `bounds` take precedence over those of the field. Raise
    UsageError for a path that is not a parameter, or if the bounds exclude all values."""
    field, _, entry = path.partition("[")
    owner, _, name = field.rpartition(".")
    fields = dict(parameters(value_at_path(blocks, owner))) if owner else {}
    if name not in fields:
        raise UsageError.of("parameter.none", path=field)
    p = fields[name]
    low, high = bounds.get(path, bounds.get(field, (p.low, p.high)))
    if not low < high:
        raise UsageError.of("parameter.bounds", path=path, low=low, high=high)
    index = tuple(int(i) for i in entry.rstrip("]").split(",")) if entry else ()
    unit = _unit(p.unit, index[0] if index else 0)
    return FreeParameter(path, unit, max(low, p.low), min(high, p.high), p, index)


def free_parameters(
    blocks: FittedBlocks,
    free: Sequence[str] | None,
    fixed_names: Iterable[str],
    bounds: Mapping[str, tuple[float, float]],
    channels: Channels = NO_CHANNELS,
    runs: Sequence[Run] = (),
) -> list[FreeParameter]:
    """Return the free parameters, once each, or raise UsageError; `channels` are those of partly used sensors."""
    field_paths = requested_paths(free, lambda: default_free(blocks, channels, runs))
    paths = [p for path in field_paths for p in entries(blocks, path)]
    fixed_paths = {p for path in fixed_names for p in entries(blocks, path)}
    for path in bounds:
        entries(blocks, path)
    free_paths = [p for p in dict.fromkeys(paths) if p not in fixed_paths]
    if not free_paths and paths:
        raise UsageError.of("parameter.all-fixed")
    explicit = [path.removeprefix("+") for path in free or ()]
    mounts = [p for p in _mounts(blocks, channels) if p not in explicit]
    ranges = {p: (value(blocks, p) - MAX_TURN_RAD, value(blocks, p) + MAX_TURN_RAD) for p in mounts}
    return [free_parameter(blocks, p, {**ranges, **bounds}) for p in free_paths]


def requested_paths(free: Sequence[str] | None, default: Callable[[], Iterable[str]]) -> list[str]:
    """Return the requested paths. They are the `default` paths if `free` is None, the `default` paths and the
    additions if all names begin with "+", else only the names."""
    additions = [path.removeprefix("+") for path in free or () if path not in ("", "+")]
    return [*default(), *additions] if adds_to_default(free) else additions


def adds_to_default(free: Sequence[str] | None) -> bool:
    """Return True if `free` is None, or if all its names begin with "+"."""
    names = ["+"] if free is None else list(free)
    return bool(names) and all(path.startswith("+") for path in names)


def enable_parameters(
    blocks: FittedBlocks,
    free: list[FreeParameter],
    rate_hz: float,
    u: np.ndarray,
    past_rows: Callable[[float], int],
) -> tuple[FittedBlocks, list[FreeParameter]]:
    """Return the blocks, changed so that every free parameter affects the output, and the parameters with their
    bounds. u (N, n) are all commands of the runs. `past_rows` returns the number of rows that a delay needs. A delay
    receives a buffer of past rows, and a lag of 0 starts at LAG_START_TICKS ticks. The limit of a motor stays below
    the largest command, else the data cannot determine it. A free effect of the battery uses the logged voltage.
    Bounds on friction keep the motion integrable within a tick. Raise UsageError for free wheel friction at track 0."""
    paths, low, high = [parameter.path for parameter in free], {}, {}
    if any(path.startswith(WHEEL_FRICTIONS) for path in paths) and blocks.model.friction.track_m == 0.0:
        raise UsageError.of("parameter.no-track")
    if BATTERY_EFFECT in paths:
        blocks = _with_drivetrain(blocks, battery="logged")
    delay_s = float(getattr(getattr(blocks.model, "drivetrain", None), "delay_s", 0.0))
    if DELAY_PATH in paths:
        delay = free[paths.index(DELAY_PATH)]
        high[DELAY_PATH] = max(delay_s, MAX_DELAY_S) if delay.high == delay.definition.high else delay.high
        delay_s = max(delay_s, high[DELAY_PATH])
    blocks = _with_delay_lines(blocks, delay_s, past_rows)
    for path in {LAG_PATH, SERVO_LAG_PATH}.intersection(paths):
        start_s, low[path] = value(blocks, path) or LAG_START_TICKS / rate_hz, MIN_LAG / rate_hz
        blocks = _with_drivetrain(blocks, **{path.rpartition(".")[2]: start_s})
    blocks = _with_drivetrain(blocks, has_back_emf=True) if BACK_EMF_PATH in paths else blocks
    for path in (path for path in paths if path.endswith(LOW_PASS)):
        sensor_path, hz = path.removesuffix(LOW_PASS), min(value(blocks, path), rate_hz)
        sensor = replace(value_at_path(blocks, sensor_path), low_pass_hz=hz)  # sets has_low_pass
        blocks, high[path] = with_value(blocks, sensor_path, sensor), MAX_LOW_PASS_RATIO * rate_hz
    if any(path.startswith(LIMIT_PATH) for path in paths):
        blocks, limits = _with_reached_limit(blocks, paths, u)
        high |= limits
    axes = coasting_axes(blocks.model)
    quadratic_bounds = _quadratic_bounds(blocks, paths, rate_hz, axes)
    high |= _friction_bounds(blocks, paths, rate_hz, axes) | quadratic_bounds
    return blocks, [
        parameter._replace(
            low=max(parameter.low, low.get(parameter.path, -np.inf)),
            high=min(parameter.high, high.get(parameter.path, np.inf)),
            is_numerical_bound=parameter.path in quadratic_bounds,
        )
        for parameter in free
    ]


def _friction_bounds(
    blocks: FittedBlocks, paths: list[str], rate_hz: float, axes: tuple[int, ...]
) -> dict[str, float]:
    """Return, for each free friction (path → value), the upper bound up to which the motion of a row is integrable.
    The free frictions of each coasting axis of `axes` share the remaining range, without those of single wheels."""
    bounds: dict[str, float] = {}
    slack = np.maximum(MAX_DECAY_PER_ROW * row_rate_hz(rate_hz) - decay_rates(blocks.model, axes), 0.0)
    fields = {path.partition("[")[0] for path in paths} - set(WHEEL_FRICTIONS)
    fields &= {path for path, p in all_parameters(blocks.model, "model") if p.role != "fixed"}
    slopes = damping_derivatives(blocks.model, fields, axes)
    free_slopes = {path: slope for path, slope in slopes if path in paths}
    for i in range(3):
        axis_paths = [path for path, slope in free_slopes.items() if slope[i] > 0.0]
        for path in axis_paths:
            bound = value(blocks, path) + float(slack[i] / (free_slopes[path][i] * len(axis_paths)))
            bounds[path] = min(bound, bounds.get(path, np.inf))
    return bounds


def _quadratic_bounds(
    blocks: FittedBlocks, paths: list[str], rate_hz: float, axes: tuple[int, ...]
) -> dict[str, float]:
    """Return, for each free quadratic friction along an axis that no command drives, the upper bound (path → value). A
    friction k θ ν² decays as fast as the speed ν permits. The inertial acceleration a sets ν: (r + k θ ν) ν = a, so
    the rate r + 2 k θ ν is √(r² + 4 k θ a), with the rate r at rest. With the largest r it is at most √2 the limit."""
    commanded_axes = driven_axes(blocks)
    if not (axes := tuple(i for i in axes if i not in commanded_axes)):
        return {}
    bounds: dict[str, float] = {}
    limit, rates = MAX_DECAY_PER_ROW * row_rate_hz(rate_hz), decay_rates(blocks.model, axes)
    fields = {path.partition("[")[0] for path in paths}
    for path, k in quadratic_damping(blocks.model, fields, axes):
        for i in (i for i in axes if path in paths and k[i] > 0.0):
            bound = float(max(limit**2 - rates[i] ** 2, 0.0) / (4.0 * k[i] * MAX_INERTIAL_M_S2))
            bounds[path] = max(bound, value(blocks, path))
    return bounds


def _with_delay_lines(
    blocks: FittedBlocks, delay_s: float, past_rows: Callable[[float], int]
) -> FittedBlocks:
    """Return the blocks with delay lines for a command delay of `delay_s` [s] and the delays of the sensors."""
    sensors = blocks.sensors
    for name, sensor in sensors._asdict().items():
        if optional.has_field(sensor, "delay_slots"):
            slots = past_rows(float(sensor.delay_s))
            sensors = sensors._replace(**{name: replace(sensor, delay_slots=slots)})
    blocks = blocks._replace(sensors=sensors)
    return _with_drivetrain(blocks, delay_slots=past_rows(delay_s)) if delay_s > 0.0 else blocks


def _with_reached_limit(
    blocks: FittedBlocks, paths: list[str], u: np.ndarray
) -> tuple[FittedBlocks, dict[str, float]]:
    """Return the blocks with the limits in `paths` below the largest command, and all largest values by path."""
    drivetrain = blocks.model.drivetrain
    if drivetrain.mixing != "none":
        u = np.stack([u[:, 0] - u[:, 2], u[:, 0] + u[:, 2]], 1)
    largest = np.max(np.abs(u), axis=0)
    largest = largest.max(keepdims=True) if drivetrain.limit.shape == (1,) else largest
    largest = largest * (1.0 - 1e-9)  # below the largest command, so that the limit has an effect
    begin = np.where(drivetrain.limit < largest, drivetrain.limit, LIMIT_START * largest)
    limit_paths = entries(blocks, LIMIT_PATH)
    limit = np.where([path in paths for path in limit_paths], begin, drivetrain.limit)
    return _with_drivetrain(blocks, limit=limit), dict(zip(limit_paths, largest.tolist(), strict=True))


def _with_drivetrain(blocks: FittedBlocks, **changes: Any) -> FittedBlocks:
    return with_value(blocks, "model.drivetrain", replace(blocks.model.drivetrain, **changes))


def substitute(blocks: FittedBlocks, paths: Iterable[str], numbers: Any) -> FittedBlocks:
    """Return the blocks with `numbers` at `paths`. The numbers can be traced; their range is not checked."""
    return with_values(blocks, [(path, numbers[k]) for k, path in enumerate(paths)])


def fixed_columns(free: list[FreeParameter], u: np.ndarray) -> list[int]:
    """Return the indices of free parameters that belong to a command which is 0 in all rows of u (N, n)."""
    still_columns = set(np.flatnonzero(~np.any(u, axis=0)).tolist())
    return [k for k, p in enumerate(free) if p.column in still_columns]


def _value_at(blocks: FittedBlocks, path: str) -> np.ndarray:
    try:
        values = np.asarray(value_at_path(blocks, path), dtype=float)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        field, bracket, entry = path.partition("[")
        names = _fields(blocks)
        hint, kind = _similar_paths(field, bracket + entry, names), type(blocks.model).__name__
        raise UsageError.of(
            "parameter.unknown", path=path, kind=kind, suggestion=hint, example=names[0]
        ) from error
    return values


def _similar_paths(field: str, entry: str, names: list[str]) -> Diagnostic:
    """Return a note with the similar path, including `entry`, and the known paths."""
    guess = nearest(field, names)
    guess = guess if "match" in guess.figures else nearest(f"model.{field}", names)
    if "match" not in guess.figures or field in names:
        return guess
    return note("name.near", match=f"{guess.figures['match']}{entry}", valid=guess.figures["valid"])


def _fields(blocks: FittedBlocks) -> list[str]:
    """Return the paths of all parameters."""
    owners = {"model": blocks.model} | {f"sensors.{k}": x for k, x in blocks.sensors._asdict().items()}
    return [path for owner, block in owners.items() for path, _ in all_parameters(block, owner)]


def _unit(text: str, first: int) -> str:
    """Return the unit of one entry: "N, N, N m per unit of u" is one unit per row."""
    row_units = text.split(", ")
    unit = row_units[min(first, len(row_units) - 1)]
    denominator = row_units[-1].partition(" per ")[2]
    return unit if not denominator or " per " in unit else f"{unit} per {denominator}"
