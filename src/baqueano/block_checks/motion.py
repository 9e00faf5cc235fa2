"""Vehicles and sensors on trial: what they promise beside purity is written in their Protocols."""

from typing import Any

import numpy as np

from baqueano.block_checks.trial import GaveUp, Trial
from baqueano.sensors.sampling import sees
from baqueano.signals import Motion, Slot
from baqueano.vehicles.effort import steady

DT_S = 0.02
TICKS = 100
ETA = np.array([0.5, -0.25, 3.0])  # close to π
NU = np.array([0.4, 0.0, 2.5])
LEVEL = np.zeros(2)


def check_vehicle(block: object) -> list[str]:
    """Sentences about a vehicle, for its author."""
    trial = Trial(block, ("init", "step", "advance", "gravity"))
    n = getattr(block, "commands", None)
    if not isinstance(n, int):
        trial.say("has no commands: write commands: ClassVar[int] = 3, the length of its command.")
    if not hasattr(getattr(block, "drivetrain", None), "step"):
        trial.say("has no drivetrain: estimators ask it what the body feels. Give it Drivetrain(commands=n).")
    try:
        if isinstance(n, int) and not any(" has no " in s for s in trial.sentences):
            _drive(trial, n)
    except GaveUp:
        pass
    return trial.done()


def _drive(trial: Trial, n: int) -> None:
    state = trial.ask("init", "at the start", ETA, NU)
    for part, shape in (("eta", (3,)), ("nu", (3,)), ("nu_dot", (3,))):
        trial.expect(f"state.{part}", getattr(state, part, None), shape, "at the start", "init")
    gravity = trial.expect("gravity", trial.ask("gravity", "at ψ = 1", 1.0), (2,), "at ψ = 1", "gravity")
    motion = None
    for k in range(TICKS):
        u = np.array([0.5, 0.0, 0.4])[:n] if n <= 3 else np.full(n, 0.3)
        state, motion = trial.step("driving a curve", state, u, DT_S, np.zeros(3))
        _motion(trial, motion, f"tick {k + 1} of a curve")
    start = trial.ask("init", "at rest")
    rest = start
    for _ in range(TICKS):
        rest, motion = trial.step("at rest, no command", rest, np.zeros(n), DT_S, np.zeros(3))
    if motion is not None and not np.any(gravity) and np.max(np.abs(motion.eta - start.eta)) > 1e-6:
        trial.say(f"moves {motion.eta - start.eta} within 2 s without a command, on a level floor.", "step")
    effort = steady(np.zeros(n))
    after = trial.ask("advance", "rolling free", ETA, NU, effort, DT_S)
    if not (isinstance(after, tuple) and len(after) == 3):
        trial.say("returns something else than (η, ν, ν̇).", "advance")
        raise GaveUp
    for name, value in zip(("η", "ν", "ν̇"), after, strict=True):
        trial.expect(name, value, (3,), "rolling free", "advance")
    trial.wrapped("ψ", float(after[0][2]), "rolling free")
    if not np.any(gravity) and (abs(after[1][0]) > abs(NU[0]) + 1e-9 or abs(after[1][2]) > abs(NU[2]) + 1e-9):
        trial.say(
            f"gains speed without a command: ν goes from {NU.tolist()} to {after[1].tolist()}.", "advance"
        )


def _motion(trial: Trial, motion: Motion, when: str) -> None:
    if not isinstance(motion, Motion):
        trial.say(
            f"returns {type(motion).__name__}: expected (state, Motion(eta, nu, nu_dot, gravity)).", "step"
        )
        raise GaveUp
    for name, shape in (("eta", (3,)), ("nu", (3,)), ("nu_dot", (3,)), ("gravity", (2,))):
        trial.expect(f"Motion.{name}", getattr(motion, name), shape, when)
    trial.wrapped("Motion.eta[2]", float(motion.eta[2]), when)


def check_sensor(block: object) -> list[str]:
    """Sentences about a sensor, for its author."""
    trial = Trial(block, ("init", "step", "h"))
    for name in ("size", "noise_size", "rate_hz", "cov"):
        if not hasattr(block, name):
            trial.say(f"has no {name}.")
    try:
        if not any(" has no " in s for s in trial.sentences):
            _measure(trial, block)
    except GaveUp:
        pass
    return trial.done()


def _measure(trial: Trial, block: Any) -> None:
    m = int(block.size)
    Q = trial.covariance("cov", block.cov, m, "the property", "h")
    if np.any(np.diag(Q) <= 0.0):
        trial.say("has a cov with 0 on its diagonal: an estimator would divide by it. Give it some noise.")
    expected = trial.expect("h", trial.ask("h", "in a curve", moving(0)), (m,), "in a curve", "h")
    state, answers = trial.ask("init", "at the start"), 0
    for k in range(TICKS):
        state, slot = trial.step("in a curve", state, moving(k), DT_S, np.zeros(int(block.noise_size)))
        if not isinstance(slot, Slot):
            trial.say(f"returns {type(slot).__name__}: expected (state, Slot(has, z)).", "step")
            raise GaveUp
        z = trial.expect("Slot.z", slot.z, expected.shape, "in a curve")
        if slot.has not in (0.0, 1.0):
            trial.say(f"says has = {slot.has}: expected 1.0 where a measurement arrived, else 0.0.", "step")
        if slot.has == 0.0 and np.any(z):
            trial.say("gives a measurement with has = 0: its z must be zeros then.", "step")
        answers += int(slot.has > 0.0)
    _rate(trial, block, answers)


def _rate(trial: Trial, block: Any, answers: int) -> None:
    if block.rate_hz == float("inf"):
        return  # it answers when something happens
    late = float(getattr(block, "delay_s", 0.0))
    in_sight = np.mean([bool(sees(block, moving(k))) for k in range(TICKS)])
    wanted = min(1.0 / DT_S, float(block.rate_hz)) * max(TICKS * DT_S - late, 0.0) * in_sight
    if abs(answers - wanted) > 2.0 + 0.05 * wanted:
        trial.say(
            f"answers {answers} times in {TICKS * DT_S:g} s: rate_hz = {block.rate_hz:g} promises "
            f"{wanted:.0f}.",
            "step",
        )


def moving(k: int) -> Motion:
    """A steady circle through ψ = π."""
    psi = ETA[2] + NU[2] * k * DT_S
    turned = (psi + np.pi) % (2.0 * np.pi) - np.pi
    return Motion(np.array([ETA[0], ETA[1], turned]), NU, np.array([0.0, 0.0, 0.0]), LEVEL)
