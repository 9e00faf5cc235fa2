"""The loop: the pure step, the clocked run, an exact replay, and a failing block."""

import signal
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from baqueano import loop
from baqueano.controllers import Pd
from baqueano.diagnostics import StopReason, note
from baqueano.estimators import Ekf
from baqueano.guides import Repeat, SinuousCircle
from baqueano.guides.shapes import circle
from baqueano.loop import Blocks
from baqueano.runs import Channel, Run
from baqueano.signals import Command, Reference, Slot, sensor_slots
from baqueano.supervisor import Supervisor
from baqueano.symbolic import compile_block
from baqueano.worlds import ReplayedWorld, SimulatedWorld, clock
from tests.light_robot import LIMIT, SENSORS, VEHICLE, R

PLAIN = Blocks(
    estimator=Ekf(VEHICLE, SENSORS, R),
    guide=SinuousCircle(radius_m=0.5, amplitude_m=0.05, speed_m_s=0.25, laps=0),
    controller=Pd(alpha=4.0, beta=2.0, gamma=0.05),
    supervisor=Supervisor(LIMIT, imu_timeout_s=5.0),
)
BLOCKS = Blocks(*(compile_block(block) for block in PLAIN))


def drive(blocks=BLOCKS, duration_s=3.0, world=None, **options):
    world = SimulatedWorld(VEHICLE, SENSORS, seed=4) if world is None else world
    records, events = [], []
    outcome = loop.run(
        blocks,
        world,
        clock.simulated_ticks(100.0, duration_s),
        records.append,
        lambda t_ns, text: events.append((t_ns, text)),
        **options,
    )
    return records, events, outcome


def replay_of(records):
    ticks = [r.tick for r in records]
    t_ns = np.array([t.t_ns for t in ticks])
    imu = [(t.t_ns, t.sensors.imu.z) for t in ticks if t.sensors.imu.is_new]
    times = np.array([t for t, _ in imu])
    channel = Channel(times, times, np.array([z for _, z in imu]))
    return ReplayedWorld(Run("test", None, t_ns, np.array([t.u for t in ticks]), sensors={"imu": channel}))


def leaves(tree):
    if isinstance(tree, tuple):
        return [leaf for branch in tree for leaf in leaves(branch)]
    return [] if tree is None else [np.asarray(tree)]


def identical(a, b):
    return all(
        np.array_equal(x, y, equal_nan=x.dtype.kind == "f") for x, y in zip(leaves(a), leaves(b), strict=True)
    )


def test_the_vehicle_follows_its_route_and_the_records_are_in_order():
    records, events, outcome = drive(duration_s=6.0)
    assert outcome == loop.Outcome(None, False, 600)
    assert events == []
    assert [r.tick.t_ns for r in records] == [10_000_000 * k for k in range(1, 601)]
    error = records[-1].reference.eta - records[-1].estimate.eta
    assert np.hypot(*error[:2]) < 0.15


def test_the_command_of_one_tick_acts_in_the_next_tick():
    records, _, _ = drive(duration_s=0.5)
    assert np.array_equal(records[0].tick.u, np.zeros(3))
    for now, after in pairwise(records):
        assert np.array_equal(after.tick.u, now.sent_command.u)


@pytest.mark.parametrize("backend", ["auto", "python", "numpy"])
def test_es12_a_replay_with_the_same_blocks_is_bit_identical(backend):
    blocks = PLAIN if backend == "numpy" else Blocks(*(compile_block(block, backend) for block in PLAIN))
    records, _, _ = drive(blocks, duration_s=0.5 if backend == "numpy" else 4.0)
    world, replayed_records = replay_of(records), []
    loop.run(blocks, world, world.times, replayed_records.append)
    assert len(replayed_records) == len(records)
    assert all(identical(a, b) for a, b in zip(records, replayed_records, strict=True))


def test_a_replay_does_not_depend_on_the_number_of_ticks_per_read():
    records, _, _ = drive(duration_s=1.0)
    world, replayed_records = replay_of(records), []
    loop.run(BLOCKS, world, world.times[6::7] + world.times[-1:], replayed_records.append)
    assert all(identical(a, b) for a, b in zip(records, replayed_records, strict=True))


def test_the_pure_step_equals_the_clocked_loop():
    records, _, _ = drive(duration_s=1.0)
    states = loop.init(BLOCKS)
    for record in records:
        states, pure = loop.step(BLOCKS, states, record.tick)
        assert identical(record, pure._replace(states=states))


class Deaf:
    """A world whose IMU is silent during an interval, and which records the motor commands."""

    def __init__(self, world, from_s, to_s):
        self.world, self.commands, self.motors = world, world.commands, []
        self.from_ns, self.to_ns = from_s * 1e9, to_s * 1e9

    def read(self, t_ns):
        silence = sensor_slots(("imu",))(Slot(0.0, np.zeros(3)))
        ticks = self.world.read(t_ns)
        return [t._replace(sensors=silence) if self.from_ns < t.t_ns <= self.to_ns else t for t in ticks]

    def write(self, command):
        self.motors.append(command.u)
        self.world.write(command)


def test_during_imu_silence_the_estimate_uses_the_applied_commands():
    faster_than_it_can = compile_block(SinuousCircle(radius_m=0.5, amplitude_m=0.05, speed_m_s=1.2, laps=0))
    eager = BLOCKS._replace(guide=faster_than_it_can)
    world = Deaf(SimulatedWorld(VEHICLE, SENSORS, seed=4), 1.0, 3.0)
    records, _, outcome = drive(eager, duration_s=4.0, world=world)
    assert outcome.stop_reason is None
    silent = records[100:300]
    assert all(r.tick.sensors.imu.is_new == 0.0 for r in silent)
    is_saturated = [np.any(np.abs(r.requested_command.u) > LIMIT + 1e-9) for r in silent]
    assert np.mean(is_saturated) > 0.5
    # the estimator used the commands that the motors received
    for k, record in enumerate(records[1:]):
        assert np.array_equal(record.tick.u, world.motors[k])
        assert np.all(np.abs(record.tick.u) <= LIMIT)
    belief = eager.estimator.init()
    for record in records:
        belief, estimate = eager.estimator.step(belief, record.tick)
        assert identical(estimate, record.estimate)
        assert np.array_equal(belief.effort, record.tick.u)
    # the covariance grows, and the predictions continue
    spread = [np.linalg.eigvalsh(r.estimate.cov[:3, :3])[-1] for r in records[99:300]]
    assert np.all(np.diff(spread) > 0.0)
    assert all(not np.array_equal(a.estimate.eta, b.estimate.eta) for a, b in pairwise(silent))
    assert np.trace(records[-1].estimate.cov[3:, 3:]) < np.trace(silent[-1].estimate.cov[3:, 3:])


class Count(NamedTuple):
    ticks: int


@dataclass(frozen=True, slots=True, eq=False)
class Failing:
    """The PD controller of the paper that fails at tick `tick` in the manner `failure`."""

    failure: str
    tick: int = 20
    pd: Any = BLOCKS.controller

    def init(self):
        return (Count(0), self.pd.init())

    def step(self, state, reference, estimate):
        count, inner = state
        inner, command = self.pd.step(inner, reference, estimate)
        state = (Count(count.ticks + 1), inner)
        if count.ticks < self.tick:
            return state, command
        if self.failure == "raises":
            return state, Command(estimate.t_ns, np.array([1.0 / 0, 0.0, 0.0]))  # the line that fails
        values = {
            "shape": Command(estimate.t_ns, np.zeros(2)),
            "nan": Command(estimate.t_ns, np.array([np.nan, 0.0, 0.0])),
            "text": Command(estimate.t_ns, np.array(["a", "b", "c"])),
            "complex": Command(estimate.t_ns, 1j * np.ones(3)),
            "stamp": Command("now", np.zeros(3)),
            "kind": command.u,
        }
        if self.failure in ("nothing", "three"):
            return None if self.failure == "nothing" else (state, command, command)
        return command if self.failure == "one" else (state, values[self.failure])


HERE = Path(__file__).name
FAILING_LINE = next(
    k
    for k, line in enumerate(Path(__file__).read_text(encoding="utf-8").splitlines(), 1)
    if "the line that fails" in line
)


@pytest.mark.parametrize(
    ("failure", "figures"),
    [
        ("raises", {"error": "ZeroDivisionError: float division by zero"}),
        ("shape", {"value": "Command.u.shape = (2,)", "expected": "(3,)"}),
        ("nan", {"value": "Command.u = [nan, 0., 0.]", "expected": note("block.finite")}),
        ("text", {"value": "Command.u = ['a', 'b', 'c']", "expected": note("block.finite")}),
        ("complex", {"value": "Command.u = [0.+1.j, 0.+1.j, 0.+1.j]", "expected": note("block.finite")}),
        ("stamp", {"value": "Command.t_ns = 'now'", "expected": note("block.finite")}),
        ("kind", {"value": "(state, ndarray)", "expected": "(state, Command(t_ns, u))"}),
        ("one", {"value": "Command", "expected": "(state, output)"}),
        ("nothing", {"value": "None", "expected": "(state, output)"}),
        ("three", {"value": "(…, …, …)", "expected": "(state, output)"}),
    ],
)
def test_rt3_a_failing_controller_stops_the_vehicle_and_logging_continues(failure, figures):
    world = Deaf(SimulatedWorld(VEHICLE, SENSORS, seed=4), 1e9, 1e9)
    records, events, outcome = drive(
        BLOCKS._replace(controller=Failing(failure)), duration_s=9.0, world=world
    )
    is_raise = failure == "raises"
    assert outcome.stop_reason.code == (StopReason.BLOCK_RAISED if is_raise else StopReason.BLOCK_RETURNED)
    assert outcome.stop_reason.figures.items() >= figures.items()
    block = outcome.stop_reason.figures["block"]
    assert block.startswith("controller Failing (")
    assert HERE in block
    if is_raise:
        assert f"{HERE}:{FAILING_LINE})" in block
    assert events == [(210_000_000, outcome.stop_reason)]
    assert len(records) == 121  # twenty good ticks, the fault, and one second after it
    assert np.any(world.motors[19] != 0.0)
    assert all(np.array_equal(u, np.zeros(3)) for u in world.motors[20:])
    assert all(np.isfinite(r.estimate.eta).all() for r in records)  # the estimator continues
    assert np.all(np.diff([r.tick.t_ns for r in records]) == 10_000_000)


@dataclass(frozen=True, slots=True, eq=False)
class BrokenBlock:
    """A block whose step does not return."""

    def init(self, *start):
        return None

    def step(self, state, *inputs):
        raise RuntimeError("out of ideas")


@pytest.mark.parametrize("room", Blocks._fields)
def test_rt3_a_failure_of_each_block_kind_stops_the_vehicle(room):
    records, events, outcome = drive(BLOCKS._replace(**{room: BrokenBlock()}), duration_s=3.0)
    assert outcome.stop_reason.code == StopReason.BLOCK_RAISED
    assert outcome.stop_reason.figures["block"].startswith(f"{room} BrokenBlock (")
    assert outcome.stop_reason.figures["error"] == "RuntimeError: out of ideas"
    assert len(events) == 1
    assert len(records) == 101
    assert all(np.array_equal(r.sent_command.u, np.zeros(3)) for r in records)
    is_estimator = room == "estimator"
    assert np.isnan(records[-1].estimate.eta).all() == is_estimator


class Odd(BaseException):
    """An exception that `except Exception` does not catch."""


@pytest.mark.parametrize("verb", ["init", "step"])
@pytest.mark.parametrize("error", [SystemExit, GeneratorExit, KeyboardInterrupt, Odd])
def test_a_block_that_ends_the_program_ends_only_its_drive(error, verb):
    def ends(self, *inputs):
        raise error

    records, events, outcome = drive(BLOCKS._replace(guide=type("Ends", (BrokenBlock,), {verb: ends})()), 3.0)
    code = StopReason.BLOCK_RAISED if verb == "step" else StopReason.BLOCK_RAISED_IN_INIT
    assert outcome.stop_reason.code == code
    assert outcome.stop_reason.figures["block"].startswith("guide Ends (")
    assert outcome.stop_reason.figures["error"] == error.__name__
    assert len(events) == 1
    assert all(np.array_equal(r.sent_command.u, np.zeros(3)) for r in records)


def test_ctrl_c_inside_a_block_is_not_a_block_fault():
    class InterruptedBlock(BrokenBlock):
        def step(self, state, *inputs):
            signal.raise_signal(signal.SIGINT)

    _, events, outcome = drive(BLOCKS._replace(guide=InterruptedBlock()))
    assert outcome.stop_reason.code == StopReason.INTERRUPTED
    assert len(events) == 1


def test_two_failing_blocks_do_not_end_the_loop():
    failing = BLOCKS._replace(controller=BrokenBlock(), estimator=BrokenBlock())
    records, _, outcome = drive(failing, duration_s=3.0)
    assert outcome.stop_reason.figures["block"].startswith("estimator BrokenBlock")
    assert len(records) == 101


def test_a_block_that_fails_in_init_prevents_the_drive():
    class NoStart(BrokenBlock):
        def init(self, *start):
            raise KeyError("route")

    records, events, outcome = drive(BLOCKS._replace(guide=NoStart()))
    assert records == []
    assert outcome.stop_reason.code == StopReason.BLOCK_RAISED_IN_INIT
    assert outcome.stop_reason.figures["error"] == "KeyError: 'route'"
    assert len(events) == 1


def test_a_nan_estimate_is_attributed_to_the_estimator():
    @dataclass(frozen=True, slots=True, eq=False)
    class Lost:
        def init(self):
            return BLOCKS.estimator.init()

        def step(self, belief, tick):
            belief, estimate = BLOCKS.estimator.step(belief, tick)
            return belief, estimate._replace(nu=estimate.nu * np.nan)

    _, _, outcome = drive(BLOCKS._replace(estimator=Lost()))
    assert outcome.stop_reason.code == StopReason.BLOCK_RETURNED
    assert outcome.stop_reason.figures["block"].startswith("estimator Lost (")
    assert outcome.stop_reason.figures["value"] == "Estimate.nu = [nan, nan, nan]"


def test_after_a_supervisor_stop_one_more_second_is_recorded():
    records, events, outcome = drive(BLOCKS._replace(supervisor=Supervisor(LIMIT, max_speed_m_s=0.2)), 9.0)
    assert outcome.stop_reason.code == StopReason.SPEED
    stop = next(k for k, r in enumerate(records) if np.hypot(*r.estimate.nu[:2]) > 0.2)
    assert events == [(records[stop].tick.t_ns, outcome.stop_reason)]
    assert len(records) == stop + 101
    assert all(np.array_equal(r.sent_command.u, np.zeros(3)) for r in records[stop:])
    assert np.hypot(*records[-1].estimate.nu[:2]) < 0.1


def test_a_guide_that_is_done_ends_the_run():
    guide = Repeat.along(circle(0.1, 0.2), laps=2)
    records, _, outcome = drive(BLOCKS._replace(guide=guide), duration_s=60.0)
    assert outcome.at_end
    assert records[-1].reference.at_end == 1.0
    assert len(records) == pytest.approx(100 * guide.duration_s, abs=3)


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_the_motors_receive_zero_at_every_end_of_the_loop(error):
    world = Deaf(SimulatedWorld(VEHICLE, SENSORS, seed=4), 1e9, 1e9)

    def interrupted():
        yield from clock.simulated_ticks(100.0, 0.3)
        raise error

    def go():
        return loop.run(BLOCKS, world, interrupted())

    if error is KeyboardInterrupt:
        assert go().stop_reason.code == StopReason.INTERRUPTED
    else:
        with pytest.raises(OSError):  # noqa: PT011  the world's own error travels on
            go()
    assert len(world.motors) == 31
    assert np.array_equal(world.motors[-1], np.zeros(3))
    assert np.any(world.motors[-2] != 0.0)


def test_the_estimator_receives_the_start_pose():
    start = np.array([1.0, 2.0, 0.5])
    records, _, _ = drive(BLOCKS._replace(guide=Repeat.along(circle(0.5, 0.01))), 0.02, eta=start)
    np.testing.assert_allclose(records[0].estimate.eta, start, atol=1e-3)
    assert isinstance(records[0].reference, Reference)


def test_all_back_ends_give_the_same_loop_records():
    ticks = [r.tick for r in drive(duration_s=0.2)[0]]
    estimates = {}
    for backend in ("auto", "python", "numpy"):
        blocks = PLAIN if backend == "numpy" else Blocks(*(compile_block(block, backend) for block in PLAIN))
        states, estimates[backend] = loop.init(blocks), []
        for tick in ticks:
            states, record = loop.step(blocks, states, tick)
            estimates[backend].append(record)
    for backend in ("auto", "python"):
        for a, b in zip(leaves(tuple(estimates[backend])), leaves(tuple(estimates["numpy"])), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def test_the_loop_can_be_written_in_eight_lines():
    estimator, guide, controller, supervisor = BLOCKS
    world, commands = SimulatedWorld(VEHICLE, SENSORS, seed=4), []
    belief, g, c, s = estimator.init(), guide.init(), controller.init(), supervisor.init()
    for t in clock.simulated_ticks(100.0, 1.0):
        for tick in world.read(t):
            belief, estimate = estimator.step(belief, tick)
        g, reference = guide.step(g, estimate)
        c, command = controller.step(c, reference, estimate)
        s, command = supervisor.step(s, command, tick, estimate)
        world.write(command)
        commands.append(command.u)
    records, _, _ = drive(duration_s=1.0)
    assert np.array_equal(commands, [r.sent_command.u for r in records])
