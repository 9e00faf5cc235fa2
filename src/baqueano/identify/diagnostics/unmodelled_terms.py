"""Compute terms that models often lack (forces, delays, sensor positions) as columns for numerics/score_test.py.

A force outside the model pushes the vehicle along an axis a with an acceleration ε φ(t). w are the channels of the
drivetrain, ν is the velocity of the model, both relative to their largest value; s is the time since a sign changed.

    ν ← ν + ε φ δ e_a,   ν̇ ← ν̇ + ε φ e_a,   D = ∂h/∂ε at ε = 0                                             (1)
    φ = tanh 10 w    w |w|    |w|    w (t/T − ½)                             dead zone … battery            (2)
        tanh 10 ν    ν |ν|    ν³     |ν|    sign ν e^(−s/0.2 s)    ∂ tanh(ν/ν_k)/∂ log ν_k       dry friction … (3)
        ν_ψ   ν_x |ν_ψ|   ν_ψ²      ν_x |ν_x| ν_ψ²   ν_x ν_ψ (sideways)      along x, in corners            (4)
        ν_x   ν_ψ |ν_x|   ν_x ν_ψ   ν_ψ ν_x²         ν_ψ |ν_ψ| (sideways)    about ψ                        (5)
    D = −ḣ  (each sensor, and all of them)    D = (−ν_ψ², ν̇_ψ), (−ν̇_ψ, −ν_ψ²), (a_y, −a_x), (−ν_ψ ν_y, ν_ψ ν_x)   (6)
    D = −τ ḣ + τ² ḧ   (the IMU, if the delay of the commands is free)
    w ← w + ε (w̄ − w),  w ← w + ε E (ν − ν̄),  w ← w − ε e^(−s/0.05 s) sign (w − E ν),  w ← w − ε q w    (7)
    ν̇_xy, g_xy ← ν̇_xy + εg, g_xy + εg    εg = −9.81 ε (cos(χ − ψ), sin(χ − ψ)), χ = 0, π/2       slope        (8)
(6): readings only. (7): lag w̄ of the motors, back-EMF behind the lag ν̄ of the model, play in gears, battery load q.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from baqueano.contracts.optional import attribute, has_field, is_dynamic
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.geometry import map_from_body
from baqueano.identify.data.averaging import WEIGHT_COLUMNS, averages
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.parameters.free import DELAY_PATH, substitute
from baqueano.identify.parameters.theta import ThetaShape
from baqueano.identify.residuals.motion import (
    Motions,
    cached_kernel,
    example,
    initial_state,
    make_row_blocks,
    mean_columns,
    motion_rows,
    read_sensors,
)
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.autocorrelation import decay_since_sign_change
from baqueano.numerics.parallel import parallel_map, prefetch
from baqueano.signals import STANDARD_GRAVITY
from baqueano.symbolic import scan
from baqueano.symbolic.scan import Scan
from baqueano.vehicles.freedoms import dry_friction_speeds, linear_drag_efforts
from baqueano.vehicles.state import tick_effort

DECAY_S = 0.2  # duration of an effect that begins when a sign changes
SIGN_WIDTH = 0.1  # fraction of the largest value: width of the tanh at a change of sign
COMMAND_TERMS = ("dead zone", "saturation", "asymmetry", "fading")
MOTOR_TERMS = ("back-emf", "motor lag", "backlash", "sag", "slow sag", "slow sag", "servo delay")  # (7)
MOTION_TERMS = (
    "dry friction", "drag", "steep drag", "one-sided drag", "caster", "friction speed", "unequal drag", "cornering",
    "turning", "slip",
)  # fmt: skip
# −(m c/I) ν_x ν_ψ about ψ shows the centre of mass c and the inertia I only as their ratio; c ν_ψ² along x shows c
TURNING_TERMS = {0: note("term.turning"), 2: note("term.turning-about")}
SIDEWAYS_TERMS = {0: note("term.sideways-slip"), 2: note("term.sideways-push")}
LOW_PASS_S = 3.6e-3  # 44 Hz, the usual setting of a small IMU
LAG_S, PAUSE_S = 0.1, 0.05  # of the motors, and of their thrust after it changed its sign
SAG_S = np.array([1e-3, 0.5, 2.0])  # lag of a battery behind its load, from a resistance to slow chemistry
SIDEWAYS_AXIS = np.array([0.0, 1.0, 0.0])
AXES = ("x", "y", "psi", "motors", "map x", "map y")
SLOPE_AXES = (4, 5)
FORCE_AXES = (0, 2)  # of all forces except the last one of each axis, which acts sideways


class Effect(NamedTuple):
    """One effect that a model can lack."""

    code: str
    description: Diagnostic
    speed: np.ndarray | float = 0.0  # (N,) change of ν_x [m/s] by a unit of the effect


# effects, and their columns D (K, N, m) in standard deviations
TermColumns: TypeAlias = tuple[list[Effect], np.ndarray]


class Force(NamedTuple):
    """One force φ along one axis, and its channel for a force of (2)."""

    code: str
    description: Diagnostic
    axis: int
    channel: int | None = None


def force_terms(axis: int, channel_count: int) -> list[Force]:
    """Return the forces along `axis` (0 or 2) in the order of the features, and then a sideways force."""
    channels = [(code, j) for code in COMMAND_TERMS for j in range(channel_count)]
    forces = [Force(f"{code} of channel {j}", _term(code), axis, j) for code, j in channels]
    notes = {code: _term(code) for code in MOTION_TERMS} | {"turning": TURNING_TERMS[axis]}
    forces += [Force(code, notes[code], axis) for code in MOTION_TERMS]
    return [*forces, Force("sideways", SIDEWAYS_TERMS[axis], 1)]


def _term(code: str) -> Diagnostic:
    return note(f"term.{code.replace(' ', '-')}")


def command_features(w: np.ndarray, record: FitRecord) -> tuple[np.ndarray, ...]:
    """Return φ, four times (N, c), of one segment with channels w (N, c), relative to their largest value.  (2)"""
    t, magnitude = np.cumsum(record.dt_s), np.abs(w)
    fading = w * (t / t[-1] - 0.5)[:, None]
    return np.tanh(w / SIGN_WIDTH), w * magnitude, magnitude, fading


def motion_features(axis: int, nu: np.ndarray, record: FitRecord, dry_speed: float) -> tuple[np.ndarray, ...]:
    """Return φ, 11 times (N, 1), of one segment with motion ν (N, 3): (3) with the speed ν_k of dry friction, then (4)
    or (5)."""
    u, s = nu[:, axis : axis + 1], nu[:, axis : axis + 1] / dry_speed
    v = u / max(float(np.max(np.abs(u))), 1e-9)
    x, w, magnitude = nu[:, :1], nu[:, 2:], np.abs(v)
    force, torque = (w, x * np.abs(w), w * w, x * np.abs(x) * w * w), (x, w * np.abs(x), x * w, w * x * x)
    corners = (*force, x * w) if axis == 0 else (*torque, w * np.abs(w))
    flips = decay_since_sign_change(v, np.cumsum(record.dt_s), DECAY_S)
    dry_force, width = np.tanh(v / SIGN_WIDTH), s * (1.0 - np.tanh(s) ** 2)
    return dry_force, v * magnitude, v * v * v, magnitude, flips, width, *corners


class ForcedState(NamedTuple):
    """State of the simulation with a push. It contains θ, because the derivatives are with respect to ε."""

    vehicle: Tree
    signals: tuple[Tree, ...]
    theta: np.ndarray
    w_lag: np.ndarray  # (k,) w̄, the channels after a lag of LAG_S
    thrust_sign: np.ndarray  # (k,)
    pause: np.ndarray  # (k,) e^(−s/PAUSE_S), s the time since the thrust changed its sign
    emf: np.ndarray  # (n, 3) E
    emf_lag: np.ndarray  # (n,) E ν after the lag of the motors
    load: np.ndarray  # (3,) q, the mean |w| of the motors after each lag of SAG_S


class FittedMotion(NamedTuple):
    """The motion that a fit predicts, segment by segment."""

    force_scan: Scan  # the kernel with a force outside the model
    starts: list[ForcedState]
    motions: list[Motions]

    @property
    def nu(self) -> np.ndarray:
        """Return ν (N, 3) of all segments."""
        return np.concatenate([m.nu for m in self.motions])

    @property
    def nu_dot(self) -> np.ndarray:
        """Return ν̇ (N, 3) of all segments."""
        return np.concatenate([m.nu_dot for m in self.motions])


def fitted_motion(blocks: FittedBlocks, problem: Residuals, theta: np.ndarray) -> FittedMotion | None:
    """Return the motion that the fit predicts, or None for a model that does not accept process noise."""
    if not has_field(blocks.model, "process_noise_std"):
        return None
    force_scan = cached_kernel(blocks, problem.shape, problem.scan.backend, _force_scan)
    starts = [_start(blocks, problem.shape, theta[index]) for index in problem.layout.indices]
    return FittedMotion(force_scan, starts, problem.motions(theta))


def _start(blocks: FittedBlocks, shape: ThetaShape, theta: np.ndarray) -> ForcedState:
    """Return the state at the start of a segment with θ (p,)."""
    motors_off = np.zeros(blocks.model.drivetrain.channels)
    emf = linear_drag_efforts(substitute(blocks, shape.paths, theta).model)
    vehicle, signals = initial_state(blocks, shape)(theta)
    no_load, signs = np.zeros(len(SAG_S)), (motors_off, motors_off)
    return ForcedState(vehicle, signals, theta, motors_off, *signs, emf, emf @ vehicle.nu, no_load)


def term_columns(
    blocks: FittedBlocks, problem: Residuals, fit_motion: FittedMotion
) -> Callable[[], list[TermColumns]]:
    """Return a function that computes the columns of a fitted motion; their slow part already runs on another core."""
    force_columns = _force_columns(blocks, problem, fit_motion)
    return lambda: [force_columns(), _reading_columns(blocks, problem, fit_motion)]


def _reading_columns(blocks: FittedBlocks, problem: Residuals, fit_motion: FittedMotion) -> TermColumns:
    """Return the terms that change only the readings.  (6)"""
    terms: list[Effect] = []
    columns = []
    for record, motion, weight in zip(problem.records, fit_motion.motions, problem.weights, strict=True):
        readings = _reading_terms(blocks, problem, record, motion)
        terms = [Effect(code, term_note) for code, term_note, _ in readings]
        columns.append(np.stack([D * weight for _, _, D in readings]))
    return terms, np.concatenate(columns, axis=1)


def _force_columns(
    blocks: FittedBlocks, problem: Residuals, fit_motion: FittedMotion
) -> Callable[[], TermColumns]:
    """Return a function that computes the columns of the forces.  (1)"""
    channels = [blocks.model.drivetrain.mix(record.u.T).T for record in problem.records]
    largest = np.max([np.max(np.abs(w), axis=0) for w in channels], axis=0)
    kernel, scale = fit_motion.force_scan, np.where(largest > 0.0, largest, 1.0)
    candidates = [force for axis in FORCE_AXES for force in force_terms(axis, len(largest))]
    candidates += [Force("slope", _term("slope"), k) for k in SLOPE_AXES]
    candidates += [Force(code, _term(code), len(AXES) - 1) for code in MOTOR_TERMS]
    speeds = dry_friction_speeds(blocks.model)

    def segment_rows(k: int) -> np.ndarray:
        record, nu = problem.records[k], fit_motion.motions[k].nu
        phi = [*command_features(channels[k] / scale, record)]
        for axis in FORCE_AXES:
            phi += motion_features(axis, nu, record, speeds[axis])
        return motion_rows(record, problem.weights[k], *phi, *mean_columns(record, problem.shape.means))

    def derivatives(k: int, rows: np.ndarray) -> np.ndarray:
        return np.asarray(kernel.sensitivities(rows, np.zeros(len(candidates)), fit_motion.starts[k])[1])

    work_rows = sum(map(len, channels)) if problem.scan.backend == "c" else 0
    if len(channels) == 1:
        all_columns = prefetch(partial(derivatives, 0, segment_rows(0)), rows=work_rows)
    else:
        count = range(len(channels))
        segments = parallel_map(lambda k: derivatives(k, segment_rows(k)), count, rows=work_rows)
        all_columns = partial(np.concatenate, segments)
    index = [k for k, force in enumerate(candidates) if force.channel is None or largest[force.channel] > 0.0]

    def columns() -> TermColumns:
        D = all_columns()  # (N, m + 1, K)
        D = D if len(index) == len(candidates) else D[:, :, index]
        forces = zip((candidates[k] for k in index), D[:, -1].T, strict=True)
        terms = [Effect(f"{force.code}, {AXES[force.axis]}", force.description, x) for force, x in forces]
        return terms, D[:, :-1].transpose(2, 0, 1)

    return columns


def _force_scan(blocks: FittedBlocks, shape: ThetaShape, backend: str) -> Scan:
    """Return the scan from ε (K,) of all forces to the readings divided by σ, and ν_x. The forces are sorted by axis;
    the last force of each axis acts sideways.  (1)"""
    n, m = blocks.model.commands, sum(s.size for s in blocks.sensors)
    channels = blocks.model.drivetrain.channels
    c, count = len(COMMAND_TERMS) * channels, len(force_terms(0, channels))
    theta, column_count = example(blocks, shape), c + len(FORCE_AXES) * (count - c)
    has_lag = blocks.model.drivetrain.has_lag and attribute(blocks.model, "viscous_effort") is not None
    slopes = slice(len(FORCE_AXES) * count, len(FORCE_AXES) * count + len(SLOPE_AXES))
    is_motor = np.arange(channels) < channels - blocks.model.drivetrain.servos

    def force_of_terms(epsilon: np.ndarray, phi: np.ndarray) -> Iterator[np.ndarray]:
        for k, axis in enumerate(FORCE_AXES):
            e, of_motion = epsilon[k * count : (k + 1) * count], phi[c + k * (count - c) :]
            force = e[:c] @ phi[:c] + e[c:-1] @ of_motion[: count - c - 1]
            yield force * np.eye(3)[axis] + e[-1] * of_motion[count - c - 1] * SIDEWAYS_AXIS

    def step(epsilon: np.ndarray, state: ForcedState, row: np.ndarray) -> tuple[ForcedState, np.ndarray]:
        tick_blocks = make_row_blocks(blocks, shape, state.theta, row)
        dt_s, u, weight = row[0], row[1 : 1 + n], row[1 + n : 1 + n + m]
        nu, psi = state.vehicle.nu, state.vehicle.eta[2]
        slope = np.concatenate([epsilon[slopes], np.zeros(1)])
        downhill = -STANDARD_GRAVITY * (map_from_body(psi).T @ slope)  # (8)
        force = downhill + sum(force_of_terms(epsilon, row[1 + n + m : 1 + n + m + column_count]))
        mean_weights = shape.mean_weights(blocks.sensors._fields, row[1 + n + m + column_count :])
        drivetrain = tick_blocks.model.drivetrain
        effort = tick_effort(tick_blocks.model, state.vehicle.drivetrain, psi, nu, u, dt_s)[1].mean
        w = drivetrain.mix(effort)
        w_lag = w + (state.w_lag - w) * is_motor * np.exp(-dt_s / LAG_S)  # of a servo: w
        emf = state.emf @ nu
        emf_lag = emf + (state.emf_lag - emf) * (np.exp(-dt_s / drivetrain.lag_s) if has_lag else 0.0)
        thrust = drivetrain.mix(effort - emf)
        sign = np.where(thrust > 0.0, 1.0, np.where(thrust < 0.0, -1.0, state.thrust_sign))
        pause = np.where(sign * state.thrust_sign < 0.0, 1.0, state.pause * np.exp(-dt_s / PAUSE_S))
        mean_load = np.abs(w) @ is_motor / max(np.sum(is_motor), 1)
        load = mean_load + (state.load - mean_load) * np.exp(-dt_s / SAG_S)
        term = epsilon[-len(MOTOR_TERMS) :]
        change = term[0] * drivetrain.mix(emf - emf_lag) - (term[3:6] @ load) * w
        change = is_motor * (change - term[2] * pause * sign)
        change = change + np.where(is_motor, term[1] * (w_lag - w), term[6] * (state.w_lag - w))
        if is_dynamic(blocks.model):
            efforts = effort + drivetrain.unmix(change), effort
            accelerations = [tick_blocks.model.nu_dot(nu, e, psi) for e in efforts]
            force = force + accelerations[0] - accelerations[1]
        vehicle = state.vehicle._replace(nu=state.vehicle.nu + force * dt_s)
        vehicle, motion = tick_blocks.model.step(vehicle, u, dt_s, np.zeros(3))
        motions, g = (motion, *(motion.tick or ())), downhill[:2]
        motion, *tick = [m._replace(nu_dot=m.nu_dot + force, gravity=m.gravity + g) for m in motions]
        motion = motion._replace(tick=tuple(tick) or None)
        readings, signals = read_sensors(tick_blocks.sensors, state.signals, motion, dt_s, mean_weights)
        next_state = ForcedState(vehicle, signals, state.theta, w_lag, sign, pause, state.emf, emf_lag, load)
        return next_state, np.concatenate([weight * np.concatenate(readings), motion.nu[:1]])

    rows = np.zeros(1 + n + m + column_count + WEIGHT_COLUMNS * len(shape.means) + shape.has_voltage)
    epsilon = np.zeros(slopes.stop + len(MOTOR_TERMS))
    return scan(step, _start(blocks, shape, theta), rows, epsilon, backend=backend)


def _reading_terms(
    blocks: FittedBlocks, problem: Residuals, record: FitRecord, motions: Motions
) -> list[tuple[str, Diagnostic, np.ndarray]]:
    """Return code, message and column (N, m) of each term that changes only the readings.  (6)"""
    h = motions.h
    dt_s = np.maximum(record.dt_s, 1e-6)
    h_dot = -np.gradient(h, np.cumsum(dt_s), axis=0)  # rows can be uneven
    terms = [("delay", note("term.delay"), h_dot)]
    for (name, span), block in zip(problem.spans.items(), blocks.sensors, strict=True):
        if (mean_weights := record.sensors[name].mean_weights) is not None:
            h_dot[:, span] = averages(mean_weights, h_dot[:, span])
        if len(problem.names) > 1:
            sensor_dot = np.zeros_like(h)
            sensor_dot[:, span] = h_dot[:, span]
            terms.append((f"delay of {name}", note("term.delay-of-sensor", subject=name), sensor_dot))
        if has_field(block, "lever_arm_m"):
            terms += _mount_terms(name, h, motions, span)
        if not getattr(block, "has_low_pass", True) and DELAY_PATH in problem.shape.shared_paths:
            filtered_readings = np.zeros_like(h)
            filtered_readings[:, span] = LOW_PASS_S * h_dot[:, span]
            slopes, steps = np.diff(h[:, span], axis=0) / dt_s[1:, None], 0.5 * (dt_s[1:-1] + dt_s[2:])
            filtered_readings[1:-1, span] += LOW_PASS_S**2 * np.diff(slopes, axis=0) / steps[:, None]
            terms.append((f"low-pass of {name}", note("term.low-pass", subject=name), filtered_readings))
    return terms


def _mount_terms(
    name: str, h: np.ndarray, motions: Motions, span: slice
) -> list[tuple[str, Diagnostic, np.ndarray]]:
    """Return the terms of an IMU that is at another place, turned, or follows the other measurement model."""
    x, y = span.start, span.start + 1
    w, w_dot = motions.nu[:, 2], motions.nu_dot[:, 2]
    terms = []
    for code, change_x, change_y in (
        ("term.imu-ahead", -w * w, w_dot),
        ("term.imu-beside", -w_dot, -w * w),
        ("term.imu-turned", h[:, y], -h[:, x]),
        ("term.measurement-model", -w * motions.nu[:, 1], w * motions.nu[:, 0]),
    ):
        D = np.zeros_like(h)
        D[:, x], D[:, y] = change_x, change_y
        terms.append((f"mount of {name}", note(code, subject=name), D))
    return terms
