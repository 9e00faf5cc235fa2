"""Check the blocks of the loop: estimator, guide, controller, supervisor."""

from contextlib import suppress
from typing import Any

import numpy as np

from baqueano.block_checks.trial import START_NOTE, CheckAborted, Trial
from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.geometry import map_from_body, wrap
from baqueano.sensors import Imu
from baqueano.signals import Command, Estimate, Motion, Reference, Slot, Tick, empty_slots, sensor_slots

DT_S = 0.02
TICK_NS = 20_000_000
YAW_RATE_RAD_S = 2.5  # rad/s: crosses π after 1.26 s
EPOCH_NS = 1_700_000_000_000_000_000  # the clock of a computer, which counts from 1970
CIRCLE_NOTE, REPEATED_TICK, FOLLOWED = note("when.circle"), note("when.repeated"), note("when.followed")
FOLLOWED_NS = 2500 * TICK_NS  # 50 s: a lap of the route of the check, and more
JUMP_TICKS = 10  # ticks of motion in one tick are a jump: 0.2 s
OUTPUT_TOLERANCE = 1e-3  # share of an output's magnitude; times converted to floats cause an error of 1e-5


def default_sensors() -> SensorBlocks:
    """Return the default sensors for a check: an IMU."""
    imu = Imu(accel_noise_std=np.array([0.1, 0.1]), gyro_noise_std=0.01)
    return sensor_slots(("imu",))(imu)


def check_estimator(
    block: object, sensors: SensorBlocks | None = None, commands: int = 3
) -> list[Diagnostic]:
    """Return the faults of an estimator.

    In the check, the estimator estimates a circle across ψ = π. It does not receive measurements for 2 s; then it
    receives damaged measurements, a repeated tick and a gap of 0.3 s.

    Parameters
    ----------
    block : object
        The estimator.
    sensors : NamedTuple of Sensor, optional
        Sensors of the vehicle, else one IMU.
    commands : int
        Channels of the vehicle's command.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> small = bq.load("small")
    >>> check_estimator(small.estimator("complementary"), small.sensors)
    []
    """
    trial = Trial(block)
    with suppress(CheckAborted):
        _check_estimates(trial, default_sensors() if sensors is None else sensors, commands)
        _check_clock_start(trial, "estimator", default_sensors() if sensors is None else sensors, commands)
    return trial.reported_faults()


def _check_estimates(trial: Trial, sensors: SensorBlocks, n: int) -> None:
    belief, t_ns = trial.checked_call("init", START_NOTE), 0
    u = np.array([0.3, 0.0, 0.3])[:n] if n <= 3 else np.full(n, 0.2)
    estimate = None
    for k in range(70):
        t_ns += TICK_NS
        belief, estimate = _checked_estimate(
            trial, belief, Tick(t_ns, u, circle_readings(sensors, k)), CIRCLE_NOTE
        )
    assert estimate is not None
    start_trace = np.trace(estimate.cov[:2, :2])
    silent_slots = empty_slots({name: s.size for name, s in sensors._asdict().items()})
    for _ in range(50):
        t_ns += 2 * TICK_NS
        belief, estimate = _checked_estimate(trial, belief, Tick(t_ns, u, silent_slots), note("when.silent"))
    if not np.trace(estimate.cov[:2, :2]) > start_trace:
        trial.add_fault("check.constant-covariance", "step")
    for value in (np.nan, np.inf):
        t_ns += TICK_NS
        slots = type(silent_slots)(*(Slot(1.0, np.full(s.size, value)) for s in sensors))
        context = note("when.after-measurement", value=str(value))
        belief, estimate = _checked_estimate(trial, belief, Tick(t_ns, u, slots), context)
    belief, _ = _checked_estimate(trial, belief, Tick(t_ns, u, silent_slots), REPEATED_TICK)
    t_ns += 15 * TICK_NS  # after a longer gap the firmware would have stopped the motors
    _checked_estimate(trial, belief, Tick(t_ns, u, circle_readings(sensors, 0)), note("when.gap"))


def _checked_estimate(trial: Trial, belief: Tree, tick: Tick, context: Diagnostic) -> tuple[Tree, Estimate]:
    belief, estimate = trial.step(context, belief, tick)
    trial.expect_record(estimate, Estimate, "(state, Estimate(t_ns, eta, nu, cov))")
    trial.check_stamp(estimate, tick.t_ns, "tick", context)
    eta = trial.expect("Estimate.eta", estimate.eta, (3,), context)
    trial.expect("Estimate.nu", estimate.nu, (3,), context)
    trial.check_wrapped("Estimate.eta[2]", float(eta[2]), context)
    cov = trial.expect_covariance("Estimate.cov", estimate.cov, 6, context)
    return belief, estimate._replace(cov=cov)


def circle_readings(sensors: SensorBlocks, k: int) -> Any:
    """Return the readings of the sensors at tick `k` on a circle at 0.3 m/s."""
    psi = wrap(YAW_RATE_RAD_S * DT_S * (k + 1))
    motion = Motion(np.array([0.0, 0.0, psi]), np.array([0.3, 0.0, YAW_RATE_RAD_S]), np.zeros(3), np.zeros(2))
    slots = sensor_slots(tuple(sensors._fields))
    return slots(*(Slot(1.0, np.asarray(s.h(motion), dtype=float)) for s in sensors))


def check_controller(block: object, commands: int = 3) -> list[Diagnostic]:
    """Return the faults of a controller.

    In the check, the controller follows a circle across ψ = π. Then it follows the same circle in a map that is moved
    and turned, and with headings that are one full turn larger. At last it rests at a reference at rest.

    Parameters
    ----------
    block : object
        The controller.
    commands : int
        Number of channels of the vehicle's command.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> check_controller(bq.load("small").controller("pd", alpha=3.0, beta=1.0))
    []
    """
    trial = Trial(block)
    with suppress(CheckAborted):
        u_plain = _circle_commands(trial, commands, np.zeros(3), 0.0)
        u_rotated = _circle_commands(trial, commands, np.array([3.0, -2.0, 2.0]), 0.0)
        u_full_turn = _circle_commands(trial, commands, np.zeros(3), 2.0 * np.pi)
        scale = 1e-6 * (1.0 + np.max(np.abs(u_plain)))
        if trial.is_deterministic and np.max(np.abs(u_full_turn - u_plain)) > scale:
            trial.add_fault("check.full-turn", "step")
        elif trial.is_deterministic and np.max(np.abs(u_rotated - u_plain)) > scale:
            trial.add_fault("check.world-moved", "step")
        _check_rest_command(trial, commands)
        _check_clock_start(trial, "controller", default_sensors(), commands)
    return trial.reported_faults()


def _check_rest_command(trial: Trial, n: int) -> None:
    rest, context, pose = np.zeros(3), note("when.rest"), np.zeros(3)
    reference, estimate = Reference(TICK_NS, pose, rest, 0.0), Estimate(TICK_NS, pose, rest, 1e-6 * np.eye(6))
    _, command = trial.step(context, trial.checked_call("init", START_NOTE), reference, estimate)
    trial.expect_record(command, Command, "(state, Command(t_ns, u))")
    trial.expect("Command.u", command.u, (n,), context)


def _circle_commands(trial: Trial, n: int, offset: np.ndarray, turn: float) -> np.ndarray:
    """Return the commands (80, n) along a circle at the pose `offset` (3,), with `turn` [rad] added to each heading.

    The last tick is repeated once.
    """
    state, command_rows = trial.checked_call("init", START_NOTE), []
    for k in [*range(80), 79]:
        t_ns, psi = (k + 1) * TICK_NS, YAW_RATE_RAD_S * DT_S * k
        position = np.array([0.1 * np.sin(psi), 0.1 * (1.0 - np.cos(psi)), psi])
        goal = position + np.array([0.02, 0.01, 0.15])
        estimate = Estimate(
            t_ns, _moved_pose(position, offset, 0.0), np.array([0.25, 0.0, YAW_RATE_RAD_S]), 1e-4 * np.eye(6)
        )
        reference = Reference(
            t_ns, _moved_pose(goal, offset, turn), np.array([0.25, 0.0, YAW_RATE_RAD_S]), 0.0
        )
        context = CIRCLE_NOTE if k < 79 or len(command_rows) < 80 else REPEATED_TICK
        state, command = trial.step(context, state, reference, estimate)
        trial.expect_record(command, Command, "(state, Command(t_ns, u))")
        trial.check_stamp(command, t_ns, "estimate", context)
        command_rows.append(trial.expect("Command.u", command.u, (n,), context))
    return np.array(command_rows[:80])


def _moved_pose(eta: np.ndarray, offset: np.ndarray, turn: float) -> np.ndarray:
    xy = offset[:2] + map_from_body(offset[2])[:2, :2] @ eta[:2]
    return np.array([xy[0], xy[1], wrap(eta[2] + offset[2]) + turn])


def check_guide(block: object) -> list[Diagnostic]:
    """Return the faults of a guide. In the check, it returns references for 3 s, at a repeated tick, and an hour later.
    Then a vehicle follows it without error, and its reference must move without jumps.

    Parameters
    ----------
    block : object
        The guide.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> check_guide(bq.load("small").guide(circle(0.3, 0.2)))
    []
    """
    trial = Trial(block)
    with suppress(CheckAborted):
        state = trial.checked_call("init", START_NOTE)
        times_ns = [
            *((k + 1) * TICK_NS for k in range(150)),
            150 * TICK_NS,
            150 * TICK_NS + 3_600_000_000_000,
        ]
        for k, t_ns in enumerate(times_ns):
            context = note("when.within") if k < 150 else REPEATED_TICK if k == 150 else note("when.later")
            eta = np.array([0.003 * k, 0.0, wrap(0.05 * k)])
            state, reference = trial.step(context, state, Estimate(t_ns, eta, np.zeros(3), 1e-4 * np.eye(6)))
            _check_reference(trial, reference, t_ns, context)
        _check_jumps(trial)
        _check_clock_start(trial, "guide", default_sensors(), 3)
    return trial.reported_faults()


def _check_jumps(trial: Trial) -> None:
    """Check that the reference moves with its velocity: a step is not longer than the motion of JUMP_TICKS ticks."""
    state, travel_m = trial.checked_call("init", START_NOTE), 0.0
    estimate = Estimate(0, np.zeros(3), np.zeros(3), 1e-4 * np.eye(6))
    for t_ns in range(TICK_NS, FOLLOWED_NS, TICK_NS):
        state, reference = trial.step(FOLLOWED, state, estimate._replace(t_ns=t_ns))
        _check_reference(trial, reference, t_ns, FOLLOWED)
        eta, nu = np.asarray(reference.eta, dtype=float), np.asarray(reference.nu, dtype=float)
        step_m, travel_m = np.hypot(*(eta - estimate.eta)[:2]), max(travel_m, DT_S * np.hypot(*nu[:2]))
        if t_ns > TICK_NS and step_m > JUMP_TICKS * travel_m:
            figures = {"step_m": float(step_m), "travel_m": float(travel_m), "t_s": t_ns * 1e-9}
            trial.add_fault("check.jump", "step", Severity.WARNING, **figures)
        if reference.at_end:
            return
        estimate = estimate._replace(eta=eta, nu=nu)


def _check_reference(trial: Trial, reference: Reference, t_ns: int, context: Diagnostic) -> None:
    trial.expect_record(reference, Reference, "(state, Reference(t_ns, eta, nu, at_end))")
    trial.check_stamp(reference, t_ns, "estimate", context)
    eta = trial.expect("Reference.eta", reference.eta, (3,), context)
    trial.expect("Reference.nu", reference.nu, (3,), context)
    trial.check_wrapped("Reference.eta[2]", float(eta[2]), context)
    if trial.expect("Reference.at_end", reference.at_end, (), context) not in (0.0, 1.0):
        trial.add_fault("check.at-end", "step", value=str(reference.at_end))


def check_supervisor(
    block: object, sensors: SensorBlocks | None = None, commands: int = 3
) -> list[Diagnostic]:
    """Return the faults of a supervisor: its commands must be safe for every input.

    Parameters
    ----------
    block : object
        The supervisor.
    sensors : NamedTuple of Sensor, optional
        Sensors of the vehicle, else one IMU.
    commands : int
        Channels of the vehicle's command.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> small = bq.load("small")
    >>> check_supervisor(small.supervisor(), small.sensors)
    []
    """
    trial = Trial(block)
    sensors = default_sensors() if sensors is None else sensors
    with suppress(CheckAborted):
        for subject, u, eta in (("Command", np.nan, 0.0), ("Estimate", 0.1, np.nan)):
            _check_stop(trial, sensors, commands, subject, u, eta)
        _check_limits(trial, sensors, commands)
        _check_clock_start(trial, "supervisor", sensors, commands)
    return trial.reported_faults()


def _check_stop(
    trial: Trial, sensors: SensorBlocks, n: int, subject: str, bad_command: float, bad_position: float
) -> None:
    """Run ten good ticks, one bad tick, and ten good ticks. From the bad tick on, the commands must be zero."""
    state = trial.checked_call("init", START_NOTE)
    for k in range(21):
        is_invalid = k == 10
        sent_command = np.full(n, bad_command if is_invalid else 0.1)
        state, u_out = _supervised_command(
            trial,
            sensors,
            state,
            k,
            sent_command,
            bad_position if is_invalid else 0.0,
            note("when.around-nan", signal=subject),
        )
        if is_invalid and np.any(u_out):
            trial.add_fault("check.nan-output", "step", u=str(u_out.tolist()), signal=subject)
        elif k > 10 and np.any(u_out):
            trial.add_fault("check.stop-not-latched", "step", signal=subject)


def _check_limits(trial: Trial, sensors: SensorBlocks, n: int) -> None:
    state = trial.checked_call("init", START_NOTE)
    limit = np.asarray(getattr(trial.block, "limit", np.full(n, np.inf)), dtype=float)
    for sign in (1.0, -1.0):
        _, u_out = _supervised_command(
            trial, sensors, state, 0, np.full(n, sign * 1e9), 0.0, note("when.large-command")
        )
        if np.any(np.abs(u_out) > np.abs(limit)):
            trial.add_fault("check.beyond-limit", "step", u=str(u_out.tolist()), limit=str(limit.tolist()))


def _supervised_command(
    trial: Trial,
    sensors: SensorBlocks,
    state: Tree,
    k: int,
    u: np.ndarray,
    position: float,
    context: Diagnostic,
) -> tuple[Tree, np.ndarray]:
    t_ns = (k + 1) * TICK_NS
    tick = Tick(t_ns, np.zeros(len(u)), circle_readings(sensors, k))
    estimate = Estimate(t_ns, np.array([position, 0.0, 0.0]), np.zeros(3), 1e-6 * np.eye(6))
    state, command = trial.step(context, state, Command(t_ns, u), tick, estimate)
    trial.expect_record(command, Command, "(state, Command(t_ns, u))")
    trial.check_stamp(command, t_ns, "command", context)
    return state, trial.expect("Command.u", command.u, (len(u),), context)


def _check_clock_start(trial: Trial, role: str, sensors: SensorBlocks, n: int) -> None:
    """Check that a clock that begins at the epoch 1970 gives the same results as a clock that begins at 0."""
    if not trial.is_deterministic:
        return
    zero_outputs = _circle_outputs(trial, role, sensors, n, 0)
    epoch_outputs = _circle_outputs(trial, role, sensors, n, EPOCH_NS)
    for name, zeros in zero_outputs.items():
        difference = wrap(epoch_outputs[name] - zeros) if name == "psi" else epoch_outputs[name] - zeros
        if not np.all(np.abs(difference) <= OUTPUT_TOLERANCE * (1.0 + np.max(np.abs(zeros)))):
            tick = int(
                np.argmax(
                    ~np.all(np.abs(difference) <= OUTPUT_TOLERANCE * (1.0 + np.max(np.abs(zeros))), axis=1)
                )
            )
            trial.add_fault(
                "check.clock", "step", name=name, begin_ns=float(EPOCH_NS), tick=tick + 1,
                value=_short_text(epoch_outputs[name][tick]), expected=_short_text(zeros[tick]),
            )  # fmt: skip
            return


def _circle_outputs(
    trial: Trial, role: str, sensors: SensorBlocks, n: int, begin_ns: int
) -> dict[str, np.ndarray]:
    """Return the outputs of the block over 20 ticks of a circle, name → (20, m)."""
    state = trial.checked_call("init", START_NOTE)
    rows = []
    context = note("when.clock", begin_ns=float(begin_ns))
    for k in range(20):
        t_ns, psi = begin_ns + (k + 1) * TICK_NS, YAW_RATE_RAD_S * DT_S * k
        eta = np.array([0.1 * np.sin(psi), 0.1 * (1.0 - np.cos(psi)), psi])
        nu = np.array([0.25, 0.0, YAW_RATE_RAD_S])
        estimate = Estimate(t_ns, eta, nu, 1e-6 * np.eye(6))
        reference = Reference(t_ns, eta + np.array([0.02, 0.01, 0.15]), nu, 0.0)
        tick = Tick(t_ns, np.full(n, 0.2), circle_readings(sensors, k))
        inputs = {
            "estimator": (tick,), "guide": (estimate,), "controller": (reference, estimate),
            "supervisor": (Command(t_ns, np.full(n, 0.2)), tick, estimate),
        }[role]  # fmt: skip
        state, output = trial.step(context, state, *inputs)
        trial.check_stamp(output, t_ns, "input", context)
        rows.append(_output_fields(output))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _output_fields(output: Any) -> dict[str, np.ndarray]:
    """Return the fields of an output that the contract requires, by name; the angle is a separate field."""
    fields = {
        name: np.asarray(getattr(output, name), dtype=float)
        for name in ("u", "nu", "at_end", "cov")
        if name in output._fields
    }
    if "eta" in output._fields:
        eta = np.asarray(output.eta, dtype=float)
        fields |= {"position": eta[:2], "psi": eta[2:]}
    return {name: np.atleast_1d(value).ravel() for name, value in fields.items()}


def _short_text(values: np.ndarray) -> str:
    return f"[{', '.join(f'{x:.3g}' for x in values[:3])}{', …' if len(values) > 3 else ''}]"
