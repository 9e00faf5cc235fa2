"""The supervisor, the last stage before the motors."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from baqueano.controllers.schedule import DelayedController
from baqueano.diagnostics import StopReason
from baqueano.drive.safety.paced_guide import PacedGuide
from baqueano.signals import Command, Estimate, Reference, Slot, Tick, sensor_slots
from baqueano.supervisor import REASONS, BlockFault, Supervisor, guard_block, stop_reason
from baqueano.symbolic import compile_block

LIMIT = np.array([1.0, 0.0, 0.5])
SUPERVISOR = Supervisor(LIMIT, max_speed_m_s=2.0, max_yaw_rate_rad_s=6.0, max_position_std_m=0.5)
Sensors = sensor_slots(("imu",))


def tick(t_s=1.0, is_new=1.0):
    return Tick(round(t_s * 1e9), np.zeros(3), Sensors(Slot(is_new, np.zeros(3))))


def estimate(nu=(0.0, 0.0, 0.0), cov=None, eta=(0.0, 0.0, 0.0)):
    cov = np.eye(6) * 1e-4 if cov is None else cov
    return Estimate(1_000_000_000, np.array(eta, dtype=float), np.array(nu, dtype=float), cov)


def command(*u):
    return Command(1_000_000_000, np.array(u, dtype=float))


def answer(c, e=None, t=None, state=None):
    state = SUPERVISOR.init() if state is None else state
    return SUPERVISOR.step(state, c, tick() if t is None else t, estimate() if e is None else e)


def test_a_command_within_the_limits_is_unchanged():
    state, out = answer(command(0.7, 0.0, -0.2))
    assert np.array_equal(out.u, [0.7, 0.0, -0.2])
    assert out.t_ns == 1_000_000_000
    assert state.stopped == 0.0
    assert stop_reason(state) is None


def test_a_command_beyond_the_limits_is_clipped():
    _, out = answer(command(7.0, 3.0, -2.0))
    assert np.array_equal(out.u, [1.0, 0.0, -0.5])


UNSURE = np.diag([0.2, 0.2, 1e-4, 1e-4, 1e-4, 1e-4])
UNSURE[0, 1] = UNSURE[1, 0] = 0.1  # 0.55 m along the diagonal, 0.45 m along x and along y


@pytest.mark.parametrize(
    ("c", "e", "reason"),
    [
        (command(np.nan, 0, 0), estimate(), 1),
        (command(0, np.inf, -np.inf), estimate(), 1),
        (command(0, 0, 0), estimate(eta=(np.nan, 0, 0)), 2),
        (command(0, 0, 0), estimate(cov=np.full((6, 6), np.inf)), 2),
        (command(0, 0, 0), estimate(nu=(1.5, 1.5, 0.0)), 3),
        (command(0, 0, 0), estimate(nu=(0.0, 0.0, -6.1)), 4),
        (command(0, 0, 0), estimate(cov=UNSURE), 5),
        (command(np.nan, 0, 0), estimate(nu=(0.0, 0.0, -6.1)), 1),
    ],
)
def test_each_stop_reason_stops_the_vehicle_and_is_named(c, e, reason):
    state, out = answer(c, e)
    assert np.array_equal(out.u, np.zeros(3))
    assert state.reason == reason
    assert stop_reason(state).code == REASONS[reason]


def test_rt6_a_silent_imu_stops_the_vehicle_exactly_after_its_timeout():
    state, _ = answer(command(1, 0, 0), t=tick(1.0))
    for t_s, is_stopped in ((1.2, 0.0), (1.5, 0.0), (1.51, 1.0)):
        state, out = answer(command(1, 0, 0), t=tick(t_s, is_new=0.0), state=state)
        assert state.stopped == is_stopped
        assert out.u[0] == 1.0 - is_stopped
    assert stop_reason(state).code == StopReason.SENSOR_SILENT


def test_an_imu_without_any_reading_stops_the_vehicle():
    state, _ = answer(command(1, 0, 0), t=tick(1.0, is_new=0.0))
    state, out = answer(command(1, 0, 0), t=tick(1.6, is_new=0.0), state=state)
    assert (state.stopped, out.u[0]) == (1.0, 0.0)


def test_a_vehicle_without_an_imu_is_not_stopped_for_imu_silence():
    signal = Tick(9_000_000_000, np.zeros(3), sensor_slots(("odometer",))(Slot(0.0, np.zeros(1))))
    state, _ = answer(command(1, 0, 0), t=tick(1.0))
    state, out = answer(command(1, 0, 0), t=signal, state=state)
    assert out.u[0] == 1.0


def test_a_stop_is_latched_with_its_first_reason():
    state, _ = answer(command(0, 0, 0), estimate(nu=(3.0, 0.0, 0.0)))
    for c in (command(0.5, 0, 0), command(np.nan, 0, 0)):
        state, out = answer(c, state=state)
        assert np.array_equal(out.u, np.zeros(3))
    assert stop_reason(state).code == StopReason.SPEED


@example([0.0, 0.0, 0.0], [1.3e308, 1.3e308, 0.0])
@given(st.lists(st.floats(), min_size=3, max_size=3), st.lists(st.floats(), min_size=3, max_size=3))
def test_rt4_no_command_exceeds_the_limits_for_any_input(u, nu):
    _, out = answer(command(*u), estimate(nu=nu))
    assert np.all(np.abs(out.u) <= LIMIT)
    if not np.all(np.isfinite(u)):
        assert np.array_equal(out.u, np.zeros(3))


class Diverging:
    """A controller and a guide whose output is not finite from the second call on."""

    def init(self):
        return 1.0

    def step(self, state, *inputs):
        output, x = inputs[0], np.where(state < 1.0, np.nan, 0.0)
        return state - 1.0, output._replace(**{name: x + getattr(output, name) for name in ("eta", "nu")})


class DivergingController(Diverging):
    def step(self, state, reference, estimate):
        state, reference = super().step(state, reference)
        return state, Command(estimate.t_ns, reference.nu)


class DivergingGuide(Diverging):
    def step(self, state, estimate):
        state, estimate = super().step(state, estimate)
        return state, Reference(estimate.t_ns, estimate.eta, estimate.nu, 0.0)


HERE = Estimate(10, np.zeros(3), np.zeros(3), np.eye(6))
STILL = Reference(10, np.zeros(3), np.zeros(3), 0.0)


@pytest.mark.parametrize(
    ("role", "block", "inputs", "name"),
    [
        ("controller", lambda part: DelayedController(part(DivergingController()), 0.0, 3), (STILL, HERE),
         "controller DivergingController ("),
        ("guide", lambda part: PacedGuide(part(DivergingGuide())), (HERE,), "guide DivergingGuide ("),
    ],
)  # fmt: skip
@pytest.mark.parametrize("part", [compile_block, lambda block: block], ids=["compiled", "as written"])
def test_a_fault_names_the_block_inside_a_wrapper(role, block, inputs, name, part):
    guard = guard_block(role, block(part), 3)
    state, _ = guard.step(guard.init(), *inputs)
    with pytest.raises(BlockFault) as error_info:
        guard.step(state, *inputs)
    assert error_info.value.reason.figures["block"].startswith(name)


class Returns:
    """A block that returns one output."""

    def __init__(self, output):
        self.output = output

    def init(self):
        return None

    def step(self, state, *inputs):
        return state, self.output


def test_an_estimate_of_lists_becomes_one_of_arrays():
    lists = HERE._replace(eta=[1, 2, 3], cov=np.eye(6).tolist())
    _, output = guard_block("estimator", Returns(lists)).step(None, tick())
    assert output.eta.dtype == float
    assert output.eta.tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(output.cov, np.eye(6))
    assert output.nu is HERE.nu


def test_the_largest_numbers_are_finite_although_their_sum_is_not():
    extreme = HERE._replace(nu=np.full(3, np.finfo(float).max))
    assert guard_block("estimator", Returns(extreme)).step(None, tick())[1] is extreme


@pytest.mark.parametrize("entry", [np.nan, np.inf, -np.inf])
def test_one_entry_that_is_not_finite_is_named(entry):
    cov = np.eye(6)
    cov[4, 5] = entry
    with pytest.raises(BlockFault) as error_info:
        guard_block("estimator", Returns(HERE._replace(cov=cov))).step(None, tick())
    assert error_info.value.reason.figures["value"].startswith("Estimate.cov = ")


@pytest.mark.parametrize(
    ("at_end", "value"),
    [
        ("yes", " = 'yes'"),
        (None, " = None"),
        (np.ones(2), ".shape = (2,)"),
        (np.inf, " = inf"),
        (1j, " = 0.+1.j"),
    ],
)
def test_a_guide_whose_end_is_not_a_number_is_named(at_end, value):
    """Before, the drive ended with an unexpected error."""
    with pytest.raises(BlockFault) as error_info:
        guard_block("guide", Returns(STILL._replace(at_end=at_end))).step(None, HERE)
    assert error_info.value.reason.code == StopReason.BLOCK_RETURNED
    assert error_info.value.reason.figures["value"] == f"Reference.at_end{value}"


@pytest.mark.parametrize(
    "at_end", [1, True, 1.0, np.float64(1.0), np.bool_(True), np.array(1.0), np.int32(0)]
)
def test_every_kind_of_number_is_an_end(at_end):
    _, output = guard_block("guide", Returns(STILL._replace(at_end=at_end))).step(None, HERE)
    assert output.at_end is at_end
