"""Check vehicles and sensors against the contracts of their protocols."""

from contextlib import suppress
from typing import Any

import numpy as np

from baqueano.block_checks.trial import START_NOTE, CheckAborted, Trial
from baqueano.contracts.optional import has_field
from baqueano.diagnostics import Diagnostic, note
from baqueano.sensors.sampling import detects
from baqueano.signals import Motion, Slot
from baqueano.vehicles.effort import constant_effort

DT_S = 0.02
TICK_COUNT = 100
ETA = np.array([0.5, -0.25, 3.0])  # close to π
NU = np.array([0.4, 0.0, 2.5])
LEVEL_GRAVITY = np.zeros(2)
CURVE_NOTE, ROLLING_NOTE, TURN_NOTE = note("when.curve"), note("when.rolling"), note("when.psi-one")


def check_vehicle(block: object) -> list[Diagnostic]:
    """Return the faults of a vehicle. In the check, the vehicle drives a curve, rests, and rolls.

    Parameters
    ----------
    block : object
        A model of motion, `vehicles.Vehicle`.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> check_vehicle(bq.load("small").vehicle)
    []
    """
    trial = Trial(block, ("init", "step", "advance", "gravity"))
    n = getattr(block, "commands", None)
    if not isinstance(n, int):
        trial.add_fault("check.no-commands")
    if not hasattr(getattr(block, "drivetrain", None), "step"):
        trial.add_fault("check.no-drivetrain")
    with suppress(CheckAborted):
        if isinstance(n, int) and not trial.is_incomplete:
            _check_drive(trial, n)
    return trial.reported_faults()


def _check_drive(trial: Trial, n: int) -> None:
    state = trial.checked_call("init", START_NOTE, ETA, NU)
    for quantity, shape in (("eta", (3,)), ("nu", (3,)), ("nu_dot", (3,))):
        trial.expect(f"state.{quantity}", getattr(state, quantity, None), shape, START_NOTE, "init")
    gravity = trial.expect(
        "gravity", trial.checked_call("gravity", TURN_NOTE, 1.0), (2,), TURN_NOTE, "gravity"
    )
    motion = None
    for k in range(TICK_COUNT):
        u = np.array([0.5, 0.0, 0.4])[:n] if n <= 3 else np.full(n, 0.3)
        state, motion = trial.step(CURVE_NOTE, state, u, DT_S, np.zeros(3))
        _check_motion(trial, motion, note("when.tick-of-curve", tick=k + 1))
    start = trial.checked_call("init", note("when.rest"))
    rest_state = start
    for _ in range(TICK_COUNT):
        rest_state, motion = trial.step(note("when.rest"), rest_state, np.zeros(n), DT_S, np.zeros(3))
    if motion is not None and not np.any(gravity) and np.max(np.abs(motion.eta - start.eta)) > 1e-6:
        trial.add_fault("check.moves-by-itself", "step", distance=str(motion.eta - start.eta))
    effort = constant_effort(np.zeros(n))
    next_state = trial.checked_call("advance", ROLLING_NOTE, ETA, NU, effort, DT_S)
    if not (isinstance(next_state, tuple) and len(next_state) == 3):
        trial.add_fault("check.returns", "advance", value=type(next_state).__name__, expected="(η, ν, ν̇)")
        raise CheckAborted
    for name, value in zip(("η", "ν", "ν̇"), next_state, strict=True):
        trial.expect(name, value, (3,), ROLLING_NOTE, "advance")
    trial.check_wrapped("ψ", float(next_state[0][2]), ROLLING_NOTE)
    if not np.any(gravity) and (
        abs(next_state[1][0]) > abs(NU[0]) + 1e-9 or abs(next_state[1][2]) > abs(NU[2]) + 1e-9
    ):
        trial.add_fault(
            "check.gains-speed",
            "advance",
            first_speed=str(NU.tolist()),
            last_speed=str(next_state[1].tolist()),
        )


def _check_motion(trial: Trial, motion: Motion, context: Diagnostic) -> None:
    trial.expect_record(motion, Motion, "(state, Motion(eta, nu, nu_dot, gravity))")
    for name, shape in (("eta", (3,)), ("nu", (3,)), ("nu_dot", (3,)), ("gravity", (2,))):
        trial.expect(f"Motion.{name}", getattr(motion, name), shape, context)
    trial.check_wrapped("Motion.eta[2]", float(motion.eta[2]), context)


def check_sensor(block: object) -> list[Diagnostic]:
    """Return the faults of a sensor. In the check, the sensor measures a circle through ψ = π.

    Parameters
    ----------
    block : object
        A model of measurement, `contracts.blocks.Sensor`.

    Returns
    -------
    list of Diagnostic
        Empty if the block fulfils its contract.

    Examples
    --------
    >>> check_sensor(bq.load("small").sensors.imu)
    []
    """
    trial, _ = _sensor_trial(block)
    if not has_field(block, "measurement_noise_cov"):
        trial.add_fault("check.no-noise-field")
    return trial.reported_faults()


def sensor_obstacle(block: object) -> Diagnostic | None:
    """Return the fault that prevents each drive with a sensor; None if its check reaches its end.

    The sensor lacks a method, raises an exception, or returns a value of another class or shape.
    """
    trial, is_complete = _sensor_trial(block)
    faults = list(trial.faults)
    return None if is_complete or faults[-1].code == "check.not-finite" else faults[-1]


def _sensor_trial(block: object) -> tuple[Trial, bool]:
    """Return the trial of a sensor, and True if it reached its end."""
    trial = Trial(block, ("init", "step", "h"))
    for name in ("size", "noise_size", "rate_hz", "cov"):
        if not hasattr(block, name):
            trial.add_fault("check.no-attribute", name=name)
    if trial.is_incomplete:
        return trial, False
    try:
        _check_measurements(trial, block)
    except CheckAborted:
        return trial, False
    return trial, True


def _check_measurements(trial: Trial, block: Any) -> None:
    m = int(block.size)
    Q = trial.expect_covariance("cov", block.cov, m, START_NOTE, "h")
    if np.any(np.diag(Q) <= 0.0):
        trial.add_fault("check.no-noise")
    sensor_h = trial.expect("h", trial.checked_call("h", CURVE_NOTE, circle_motion(0)), (m,), CURVE_NOTE, "h")
    state, reading_count = trial.checked_call("init", START_NOTE), 0
    for k in range(TICK_COUNT):
        state, slot = trial.step(CURVE_NOTE, state, circle_motion(k), DT_S, np.zeros(int(block.noise_size)))
        trial.expect_record(slot, Slot, "(state, Slot(is_new, z))")
        z = trial.expect("Slot.z", slot.z, sensor_h.shape, CURVE_NOTE)
        is_new = trial.expect("Slot.is_new", slot.is_new, (), CURVE_NOTE)
        if is_new not in (0.0, 1.0):
            trial.add_fault("check.is-new", "step", value=str(slot.is_new))
        if is_new == 0.0 and np.any(z):
            trial.add_fault("check.not-new", "step")
        reading_count += int(is_new > 0.0)
    _check_rate(trial, block, reading_count)


def _check_rate(trial: Trial, block: Any, reading_count: int) -> None:
    if block.rate_hz == float("inf"):
        return  # this sensor measures when something happens
    delay_s = float(getattr(block, "delay_s", 0.0))
    sight_share = np.mean([bool(detects(block, circle_motion(k))) for k in range(TICK_COUNT)])
    expected_count = (
        min(1.0 / DT_S, float(block.rate_hz)) * max(TICK_COUNT * DT_S - delay_s, 0.0) * sight_share
    )
    if abs(reading_count - expected_count) > 2.0 + 0.05 * expected_count:
        duration_s, rate_hz = TICK_COUNT * DT_S, block.rate_hz
        trial.add_fault(
            "check.rate",
            "step",
            count=reading_count,
            duration_s=duration_s,
            rate_hz=rate_hz,
            expected=expected_count,
        )


def circle_motion(k: int) -> Motion:
    """Return the motion of tick `k` on a steady circle through ψ = π."""
    psi = ETA[2] + NU[2] * k * DT_S
    heading = (psi + np.pi) % (2.0 * np.pi) - np.pi
    return Motion(np.array([ETA[0], ETA[1], heading]), NU, np.array([0.0, 0.0, 0.0]), LEVEL_GRAVITY)
