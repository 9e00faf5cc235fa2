"""The unscented filter: equal to filterpy, exact as in the textbook, and consistent on the independent truth.

False-alarm rate of the NEES band: once in 10,000 choices of the seed, which is fixed.
"""

import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, UnscentedKalmanFilter
from scipy.stats import chi2

from baqueano.estimators import Ekf, Unscented
from baqueano.estimators.covariance import cholesky_root
from baqueano.estimators.kalman import Gaussian
from baqueano.estimators.sigma_points import propagate
from baqueano.geometry import map_from_body, wrap
from baqueano.sensors import Imu, Pose
from baqueano.signals import Motion, Slot, Tick, empty_slots, sensor_slots
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group, robot_file
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.truth import draw_robots
from baqueano.symbolic import compile_block, scan
from baqueano.vehicles import Kinematic, constant_effort
from tests.codes import refused
from tests.light_robot import DRAGGED as SMALL

IMU = Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005)
Sensors = sensor_slots(("imu",))
R = np.diag([1e-4, 1e-4, 1e-3, 0.05, 0.05, 0.5]) ** 2
BROAD = np.array([0.05, 0.05, 0.3, 0.1, 0.05, 0.5, 0.1, 0.1, 0.5])


def circle(n, seed=50):
    rng = np.random.default_rng(seed)
    for k in range(1, n + 1):
        u = np.array([0.5, 0.0, 0.3 * np.sin(0.1 * k)])
        yield Tick(k * 10_000_000, u, Sensors(Slot(1.0, rng.normal(0.0, [0.3, 0.3, 1.0]))))


def filterpys(x, P):
    """Return the filter of filterpy with the same points, and explicit g and h."""
    before = [np.zeros(3)]

    def g(x, dt, u):
        a_d = x[6:] - SMALL.nu_dot(x[3:6], before[0])
        eta, nu, _ = SMALL.advance(x[:3], x[3:6], constant_effort(u), dt)
        eta = eta + map_from_body(eta[2]) @ (0.5 * dt**2 * a_d)
        nu = nu + dt * a_d
        return np.concatenate([eta, nu, SMALL.nu_dot(nu, u) + np.exp(-dt / 0.5) * a_d])

    def mean(points, weights):
        m = weights @ points
        m[2] = np.arctan2(weights @ np.sin(points[:, 2]), weights @ np.cos(points[:, 2]))
        return m

    def difference(a, b):
        d = a - b
        d[2] = wrap(d[2])
        return d

    def h(x):
        return IMU.h(Motion(x[:3], x[3:6], x[6:], np.zeros(2)))

    points = JulierSigmaPoints(9, kappa=0.0, subtract=difference)
    ukf = UnscentedKalmanFilter(9, 3, 0.01, h, g, points, x_mean_fn=mean, residual_x=difference)
    ukf.x, ukf.P, ukf.R = x.copy(), P.copy(), IMU.cov
    return ukf, before


def test_the_unscented_filter_equals_filterpy():
    """The headings differ by 0.01 rad at most, so the mean of filterpy equals the mean of this package."""
    block = Unscented(SMALL, Sensors(IMU), R, gate_sigma=np.inf, initial_std=1e-2 * BROAD)
    belief = block.init()
    ukf, before = filterpys(belief.mean, belief.cov)
    ukf.Q = np.zeros((9, 9))
    ukf.Q[3:, 3:] = R
    for tick in circle(40):
        ukf.predict(u=tick.u)
        ukf.update(tick.sensors.imu.z)
        before[0] = tick.u
        belief, estimate = block.step(belief, tick)
        np.testing.assert_allclose(belief.mean, ukf.x, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(belief.cov, ukf.P, rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(estimate.innovation, ukf.y, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(estimate.innovation_cov, ukf.S, rtol=1e-5, atol=1e-9)


def test_the_transform_is_exact_for_linear_functions_and_the_mean_of_squares():
    rng = np.random.default_rng(51)
    A, G = rng.normal(size=(5, 5)), rng.normal(size=(3, 5))
    x = Gaussian(np.zeros(5), A @ A.T)
    moments = propagate(
        lambda x: G @ np.concatenate([x[:2], x[2:]]), Gaussian(x.mean, 1e-2 * x.cov / np.trace(x.cov))
    )
    np.testing.assert_allclose(moments.mean, 0.0, atol=1e-14)
    np.testing.assert_allclose(moments.even_part, 0.0, atol=1e-14)
    np.testing.assert_allclose(
        moments.odd_part @ moments.odd_part.T, 1e-2 * G @ x.cov @ G.T / np.trace(x.cov), atol=1e-14
    )
    square = propagate(lambda x: x**2, Gaussian(np.zeros(3), np.diag([4.0, 9.0, 0.01])))
    np.testing.assert_allclose(square.mean, [4.0, 9.0, 0.01], rtol=1e-12)


def test_the_mean_heading_across_pi_is_correct():
    x = Gaussian(np.array([0.0, 0.0, np.pi - 0.01]), np.diag([1e-6, 1e-6, 0.04]))
    moments = propagate(lambda p: np.array([wrap(p[2] - x.mean[2])]), x)
    assert abs(moments.mean[0]) < 1e-12
    assert moments.odd_part[0] @ moments.odd_part[0] == pytest.approx(0.04)


def test_the_square_root_of_a_singular_covariance_is_correct():
    rng = np.random.default_rng(52)
    A = rng.normal(size=(6, 4))
    P = np.zeros((8, 8))
    P[1:7, 1:7] = A @ A.T  # rank 4 of 6, between two rows of zeros
    np.testing.assert_allclose(cholesky_root(P) @ cholesky_root(P).T, P, atol=1e-12)


def test_an_uncertain_heading_gives_a_more_accurate_pose_than_the_ekf():
    """Two seconds straight ahead from a heading known to 0.3 rad: the mean distance is shorter by e^(−σ²/2)."""
    sigma, silence = 0.3, Sensors(Slot(0.0, np.zeros(3)))
    std = np.array([1e-3, 1e-3, sigma, *np.full(6, 1e-3)])
    poses = []
    for kind in (Ekf, Unscented):
        block = compile_block(kind(SMALL, Sensors(IMU), 1e-4 * R, initial_std=std), "python")
        belief = block.init(nu=np.array([0.4, 0.0, 0.0]))
        for k in range(1, 201):
            belief, estimate = block.step(belief, Tick(k * 10_000_000, np.array([0.5, 0.0, 0.0]), silence))
        poses.append(estimate.eta[0])
    assert poses[1] / poses[0] == pytest.approx(np.exp(-(sigma**2) / 2.0), rel=0.005)


def test_nees_and_nis_lie_in_their_bands_on_the_independent_truth():
    """R of ν equals the floor noise of the truth; R of ν̇ is small compared with the accelerometer noise."""
    n, ticks = 5, 400
    physics = draw_robots(n, 7)
    steps = np.arange(ticks)
    u = np.column_stack(
        [0.75 + 0.1 * np.sin(0.03 * steps), 0.0 * steps, np.where(steps // 150 % 2, 0.1, -0.1)]
    )
    motion = drive_group(
        physics, np.repeat(u[:, None], n, axis=1), range(n), tick_times(ticks, 100.0), ROBOT_STEP_S
    )
    process = np.diag([0.005, 0.002, 0.005, 0.03, 0.03, 0.01]) ** 2 * 0.01
    silent_tick, nees, nis = Tick(10_000_000, np.zeros(3), empty_slots({"imu": 3})), 0.0, []
    for i in range(n):
        file = robot_file(physics.subset([i]))
        block = Unscented(file.vehicle, file.sensors, process)
        slots = type(file.sensors)(Slot(np.ones(ticks), motion.readings[:, i], np.zeros(ticks)))
        belief, estimates = scan(block.step, block.init(), silent_tick, backend="python").run(
            Tick(10_000_000 * (steps + 1), u, slots)
        )
        e = motion.truth[-1, i, :6] - belief.mean[:6]
        e[2] = wrap(e[2])
        nees += e @ np.linalg.solve(belief.cov[:6, :6], e)
        nis.append(np.mean(estimates.innovation**2 / np.einsum("kii->ki", estimates.innovation_cov), axis=0))
    low, high = chi2.ppf([5e-5, 1 - 5e-5], 6 * n)
    assert low < nees < high, f"NEES {nees / (6 * n):.2f} of its mean"
    assert np.all(np.abs(np.mean(nis, axis=0) - 1.0) < 0.15), f"NIS {np.mean(nis, axis=0)}"


def test_a_pose_innovation_is_wrapped_across_pi():
    sensors = sensor_slots(("pose",))(Pose(noise_std=np.array([0.01, 0.01, 0.02])))
    block = Unscented(SMALL, sensors, R, use=("pose",), initial_std=np.full(9, 0.05))
    slot = sensor_slots(("pose",))(Slot(1.0, np.array([0.0, 0.0, -np.pi + 0.02])))
    belief = block.init(eta=np.array([0.0, 0.0, np.pi - 0.02]))
    _, estimate = block.step(belief, Tick(10_000_000, np.zeros(3), slot))
    assert abs(estimate.innovation[2] - 0.04) < 1e-3
    assert abs(wrap(estimate.eta[2] - np.pi)) < 0.02


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"use": ("gps",)}, ("field.use", {"value": "gps", "valid": "imu"})),
        (
            {"vehicle": Kinematic(velocity_matrix=np.eye(3))},
            ("unscented.no-acceleration", {"vehicle": "Kinematic"}),
        ),
    ],
)
def test_unsupported_settings_are_refused_with_a_reason(options, words):
    with refused(words[0], ValueError, **words[1]):
        Unscented(**{"vehicle": SMALL, "sensors": Sensors(IMU), "process_noise_cov": R} | options)
