"""Properties of every good filter: invalid data have no effect, missing readings increase the uncertainty, and
frames do not change the result.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from baqueano.estimators import Ekf, Unscented
from baqueano.estimators.readings.gate import gate_limit
from baqueano.geometry import wrap
from baqueano.sensors import Imu
from baqueano.signals import Slot, Tick, sensor_slots
from baqueano.symbolic import compile_block
from baqueano.vehicles import Drivetrain, Kinematic, constant_effort
from tests.codes import refused
from tests.light_robot import DRAGGED as SMALL

Sensors = sensor_slots(("imu",))
IMU = Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005)
R = np.diag([1e-4, 1e-4, 1e-3, 0.05, 0.05, 0.5]) ** 2


@cache
def ekf(**options):
    return compile_block(Ekf(SMALL, Sensors(IMU), R, **options), "python")


def tick(k, u=(0.4, 0.0, 0.1), z=None, dt_ns=10_000_000):
    slot = Slot(0.0, np.zeros(3)) if z is None else Slot(1.0, np.array(z, dtype=float))
    return Tick(k * dt_ns, np.array(u), Sensors(slot))


def after(filter_, ticks, belief=None):
    belief = filter_.init() if belief is None else belief
    estimate = None
    for t in ticks:
        belief, estimate = filter_.step(belief, t)
    return belief, estimate


def is_equal(a, b):
    return all(np.array_equal(x, y, equal_nan=True) for x, y in zip(a, b, strict=True))


GOOD = [tick(k, z=(0.3, 0.02, 0.1)) for k in range(1, 6)]


class PartOfImu(NamedTuple):
    """A sensor that has only some channels of an IMU: an oracle for readings in which the others are NaN."""

    imu: Imu
    channels: list[int]
    kind: str = "imu"
    rate_hz: float = 100.0
    delay_s: float = 0.0
    delay_slots: int = 0

    @property
    def size(self):
        return len(self.channels)

    @property
    def cov(self):
        return self.imu.cov[np.ix_(self.channels, self.channels)]

    def h(self, motion):
        return self.imu.h(motion)[self.channels]


@pytest.mark.parametrize("kind", [Ekf, Unscented])
@pytest.mark.parametrize(
    "value", [(np.nan, 0.01, 0.1), (0.3, np.inf, 0.1), (0.3, np.nan, -np.inf), (np.nan,) * 3]
)
def test_es4_a_channel_that_is_not_finite_leaves_no_trace_in_the_state(kind, value):
    finite = [int(k) for k in np.flatnonzero(np.isfinite(value))]
    full, part = (
        compile_block(kind(SMALL, Sensors(imu), R), "python") for imu in (IMU, PartOfImu(IMU, finite))
    )
    belief, _ = after(full, GOOD)
    hit, estimate = full.step(belief, tick(6, z=value))
    expected, _ = part.step(belief, tick(6, z=np.array(value)[finite]))
    np.testing.assert_allclose(hit.mean, expected.mean, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(hit.cov, expected.cov, rtol=1e-9, atol=1e-18)
    assert np.array_equal(np.isfinite(estimate.innovation), np.isfinite(value))
    assert np.array_equal(np.isfinite(estimate.weight), np.isfinite(value))


def test_es4_a_command_that_is_not_finite_does_not_enter_the_state():
    belief, _ = after(ekf(), GOOD)
    hit, _ = ekf().step(belief, tick(6, u=(np.nan, 0.0, 0.1)))
    zero, _ = ekf().step(belief, tick(6, u=(0.0, 0.0, 0.1)))
    assert is_equal(hit[:4], zero[:4])


def test_a_spike_beyond_four_sigma_is_rejected_and_reported():
    belief, _ = after(ekf(), GOOD)
    hit, estimate = ekf().step(belief, tick(6, z=(50.0, 0.0, 0.0)))
    silent, _ = ekf().step(belief, tick(6))
    assert is_equal(hit[:4], silent[:4])
    assert estimate.innovation[0] > 40.0


def test_the_gate_is_the_chi_square_quantile_of_four_sigma():
    from scipy.stats import chi2, norm

    for m in (1, 2, 3, 5, 6):
        assert gate_limit(4.0, m) == pytest.approx(chi2.isf(2.0 * norm.sf(4.0), m), rel=1e-9)
    assert gate_limit(np.inf, 3) == np.inf


def test_es11_a_repeated_or_delayed_tick_does_not_change_the_estimate():
    belief, _ = after(ekf(), GOOD)
    for t in (GOOD[-1], GOOD[2]):
        same_belief, estimate = ekf().step(belief, t)
        assert is_equal(same_belief[:4], belief[:4])
        assert estimate.t_ns == t.t_ns


def test_uncertainty_grows_and_motion_continues_during_two_seconds_without_readings():
    belief, before = after(ekf(), GOOD)
    trace, position = [np.trace(belief.cov[:6, :6])], [before.eta[0]]
    for k in range(6, 206):
        belief, estimate = ekf().step(belief, tick(k))
        trace.append(np.trace(estimate.cov))
        position.append(estimate.eta[0])
    assert np.all(np.diff(trace) > 0.0)
    assert np.all(np.diff(position) > 0.0)
    assert np.isfinite(belief.mean).all()


def test_es10_heading_crosses_pi_between_two_ticks_without_a_jump():
    filter_ = ekf()
    belief, psi = filter_.init(eta=np.array([0.0, 0.0, 3.0]), nu=np.array([0.0, 0.0, 2.0])), [3.0]
    for k in range(1, 40):
        belief, estimate = filter_.step(belief, tick(k, u=(0.0, 0.0, 0.5), z=(0.0, 0.0, 2.0)))
        psi.append(estimate.eta[2])
    assert min(psi) < -3.0
    assert np.all(np.abs(psi) <= np.pi)
    steps = wrap(np.diff(psi))
    assert np.all((steps > 0.0) & (steps < 0.1))


@pytest.mark.parametrize(("mode", "order"), [("default", 4), ("paper", 1)])
def test_the_prediction_error_has_order_four_or_order_one_in_paper_mode(mode, order):
    """Global error after 0.4 s against a fine integration, by the slope of its logarithm."""
    nu0 = np.array([0.3, 0.1, 1.5])

    def predicted(n):
        filter_ = ekf(mode=mode, rate_hz=n / 0.4)
        ticks = [tick(k, u=(0.8, 0.0, 0.3), dt_ns=400_000_000 // n) for k in range(1, n + 1)]
        return after(filter_, ticks, filter_.init(nu=nu0))[0].mean[:6]

    fine = SMALL
    eta, nu = np.zeros(3), nu0
    for _ in range(4000):
        eta, nu, _ = fine.advance(eta, nu, constant_effort(np.array([0.8, 0.0, 0.3])), 0.4 / 4000)
    exact = np.concatenate([eta, nu])
    n = np.array([16, 32, 64, 128]) if order == 1 else np.array([16, 32, 64])  # each tick is one row
    errors = [np.linalg.norm(predicted(int(i)) - exact) for i in n]
    slope = -np.polyfit(np.log(n), np.log(errors), 1)[0]
    assert slope == pytest.approx(order, abs=0.25)


def test_the_process_noise_variance_is_proportional_to_time():
    flat = Ekf(Kinematic(velocity_matrix=np.eye(3)), Sensors(IMU), R)
    a = after(flat, [tick(k, dt_ns=20_000_000) for k in range(1, 3)])[0]
    b = after(flat, [tick(k, dt_ns=10_000_000) for k in range(1, 3)])[0]
    np.testing.assert_allclose(np.diag(a.cov)[3:6], 2.0 * np.diag(b.cov)[3:6], rtol=1e-12)


def test_unexplained_acceleration_decays_with_its_time_constant():
    filter_ = ekf(disturbance_time_s=0.1)
    belief = filter_.init()
    belief = belief._replace(mean=np.array([0, 0, 0, 0, 0, 0, 1.0, 0, 0.0]))
    belief, _ = after(filter_, [tick(k, u=(0.0, 0.0, 0.0)) for k in range(1, 11)], belief)
    a_d = belief.mean[6] - SMALL.nu_dot(belief.mean[3:6], np.zeros(3))[0]
    assert a_d == pytest.approx(np.exp(-1.0), rel=1e-9)


def test_the_estimator_models_the_drivetrain_delay_of_the_vehicle():
    drivetrain = Drivetrain(delay_s=0.03, delay_slots=3, limit=np.array([0.5, 0.5, 0.5]))
    delayed_vehicle = replace(SMALL, drivetrain=drivetrain)
    filter_ = Ekf(delayed_vehicle, Sensors(IMU), R)
    belief, efforts = filter_.init(), []
    for k in range(1, 7):
        belief, _ = filter_.step(belief, tick(k, u=(2.0, 0.0, 0.0)))
        efforts.append(belief.effort[0])
    assert efforts == [0.0, 0.0, 0.0, 0.5, 0.5, 0.5]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mode": "papr"}, ("ekf.mode", {"value": "papr", "valid": "default, paper"})),
        ({"use": ("gps",)}, ("field.use", {"value": "gps", "valid": "imu"})),
        ({"gate_sigma": 0.0}, ("ekf.positive", {"gate_sigma": 0.0})),
        ({"initial_std": np.zeros(9)}, ("ekf.initial-std", {})),
        (
            {"process_noise_cov": np.eye(5)},
            ("cov.shape", {"name": "process_noise_cov", "value": "(5, 5)", "size": 6}),
        ),
        (
            {"process_noise_cov": np.diag([1, 1, np.nan, 1, 1, 1])},
            ("cov.not-finite", {"name": "process_noise_cov", "i": 2, "j": 2}),
        ),
    ],
)
def test_bad_settings_are_refused_with_a_reason(options, words):
    options = {"process_noise_cov": R} | options
    with refused(words[0], ValueError, **words[1]):
        Ekf(SMALL, Sensors(IMU), **options)
