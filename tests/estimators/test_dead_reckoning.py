"""Dead reckoning drifts, and its covariance equals that of a Monte Carlo simulation.

False-alarm rates: a correct variance lies outside its χ² band once in 10,000 choices of the seed; the seeds are
fixed.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from baqueano.estimators import Complementary, DeadReckoning
from baqueano.estimators.readings.sensor_numbers import ACCEL_SCALE_STD
from baqueano.geometry import compose, wrap
from baqueano.sensors import Imu, Odometer, Pose, Wheels
from baqueano.signals import Slot, Tick, empty_slots, sensor_slots
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.truth import draw_robots
from baqueano.symbolic import compile_block, scan
from baqueano.vehicle_file import load
from baqueano.vehicles import Car, Drivetrain, Kinematic
from tests.codes import refused
from tests.light_robot import SMALL

DT = 0.01
FALSE_ALARM = 1e-4
MODEL = Kinematic(velocity_matrix=np.diag([0.5, 0.0, 3.0]))  # nothing slips sideways
IMU = Imu(gyro_noise_std=0.005, accel_noise_std=np.array([0.1, 0.1]), gyro_scale=1.03, gyro_bias=0.02)
WHEELS = Wheels(track_m=0.12, noise_std=0.02, radius_scale=np.array([1.02, 0.97]))
ODOMETER = Odometer(scale=1.02, noise_std=0.02)
R = np.diag([1e-6, 1e-8, 1e-6, 1.0, 1.0, 1.0])
WHERE = {"x": 0, "y": 1, "heading": 2}


def sensors(**sensors_by_name):
    return sensor_slots(tuple(sensors_by_name))(*sensors_by_name.values())


def reckoning(vehicle=SMALL, **fields):
    options = {k: fields.pop(k) for k in list(fields) if not hasattr(fields[k], "h")}
    return DeadReckoning(vehicle, sensors(**(fields or {"imu": IMU})), R, rate_hz=100.0, **options)


def drive_truth(n, t_s):
    """Return ν (N + 1, 3) of a slalom, and η (N + 1, 3) integrated in steps of 1 ms."""
    fine = np.arange(n * 10 + 1) * 1e-3
    v, w = 0.3 * (1.0 - np.exp(-fine / 0.3)), 0.5 + 1.2 * np.sin(0.9 * fine)
    stopping = np.sin(0.5 * np.pi * np.clip((t_s - fine) / 0.3, 0.0, 1.0)) ** 2
    v, w = v * stopping, w * (1.0 - np.exp(-fine / 0.2)) * stopping
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * 1e-3)])
    middle = 0.5 * (psi[1:] + psi[:-1])
    path_m = 0.5 * (v[1:] + v[:-1]) * 1e-3
    xy = np.cumsum(path_m[:, None] * np.stack([np.cos(middle), np.sin(middle)], 1), axis=0)
    eta = np.column_stack([np.concatenate([np.zeros((1, 2)), xy]), psi])
    return np.column_stack([v, 0.0 * v, w])[::10], eta[::10]


def make_ticks(reckon, readings, u=None):
    """Return ticks (N,) with readings {name: z (N, m)}, one of each sensor per tick; NaN means no reading."""
    slots = []
    for name in reckon.sensors._fields:
        z = readings.get(
            name, np.full((len(next(iter(readings.values()))), getattr(reckon.sensors, name).size), np.nan)
        )
        slots.append(Slot(np.isfinite(z[:, 0]).astype(float), np.nan_to_num(z), np.zeros(len(z))))
    n = len(slots[0].is_new)
    commands = np.zeros((n, reckon.vehicle.commands)) if u is None else u
    return Tick(10_000_000 * np.arange(1, n + 1), commands, type(reckon.sensors)(*slots))


def kernel_of(reckon, start=None):
    silence = empty_slots({name: s.size for name, s in reckon.sensors._asdict().items()})
    belief = reckon.init() if start is None else start
    return scan(reckon.step, belief, Tick(10_000_000, np.zeros(reckon.vehicle.commands), silence))


@pytest.mark.parametrize("speed", [{"wheels": WHEELS}, {"odometer": ODOMETER}], ids=["wheels", "odometer"])
def test_the_covariance_matches_a_monte_carlo_simulation(speed):
    """Bias, bias walk, both scales, white noise and the start are random; everything else is exact."""
    runs, n = 400, 2000
    rng = np.random.default_rng(30)
    bias_std, gyro_std, speed_std = 6e-4, 4e-3, 2e-3
    imu = replace(IMU, gyro_bias_walk=1e-4, gyro_bias_std=bias_std, gyro_scale_std=gyro_std)
    ((name, sensor),), start_std = speed.items(), np.array([2e-3, 2e-3, 4e-3])
    sensor = replace(sensor, **{"radius_scale_std" if name == "wheels" else "scale_std": speed_std})
    first = np.concatenate([start_std, [1e-3, 1e-3, 1e-3]])
    reckon = reckoning(MODEL, imu=imu, **{name: sensor}, initial_std=first)
    nu, eta = drive_truth(n, 1e9)
    w = nu[1:, 2]
    if name == "wheels":
        ideal = WHEELS.radius_scale * np.stack([nu[1:, 0] - 0.06 * w, nu[1:, 0] + 0.06 * w], 1)
    else:
        ideal = 1.02 * nu[1:, :1]
    kernel, errors = kernel_of(reckon), []
    for _ in range(runs):
        walk = np.cumsum(imu.gyro_bias_walk * np.sqrt(DT) * rng.standard_normal(n))
        bias = 0.02 + bias_std * rng.standard_normal() + walk
        gyro = 1.03 * (1.0 + gyro_std * rng.standard_normal()) * w + bias
        z = np.column_stack([np.zeros((n, 2)), gyro + 0.005 * rng.standard_normal(n)])
        scale = 1.0 + speed_std * rng.standard_normal()
        readings = {"imu": z, name: scale * ideal + 0.02 * rng.standard_normal(ideal.shape)}
        belief, _ = kernel.run(make_ticks(reckon, readings))
        start_eta = start_std * rng.standard_normal(3)
        truth = compose(start_eta, eta[-1])
        errors.append([*(truth - belief.mean[:3])[:2], wrap(truth[2] - belief.mean[2])])
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], runs) / runs
    variances = np.mean(np.square(errors), axis=0) / np.diag(belief.cov)[:3]
    for quantity, k in WHERE.items():
        assert low < variances[k] < high, f"{quantity}: {variances[k]:.3f} of the claimed variance"


@pytest.mark.parametrize("kind", [DeadReckoning, Complementary])
def test_one_wheel_and_the_gyro_give_the_speed_while_the_other_wheel_is_nan(kind):
    wheels, nu = replace(WHEELS, radius_scale=np.ones(2)), np.array([0.4, 0.0, 1.5])
    blocks = sensors(imu=replace(IMU, gyro_scale=1.0, gyro_bias=0.0), wheels=wheels)
    estimator = kind(MODEL, blocks, R, rate_hz=100.0) if kind is DeadReckoning else kind(MODEL, blocks)
    left, right = nu[0] - 0.06 * nu[2], nu[0] + 0.06 * nu[2]
    for z in ([left, right], [np.nan, right], [left, np.inf]):
        belief = estimator.init()
        for k in range(1, 201):
            slots = type(blocks)(Slot(1.0, np.array([0.0, 0.0, nu[2]])), Slot(1.0, np.array(z)))
            belief, estimate = estimator.step(belief, Tick(10_000_000 * k, np.zeros(3), slots))
        assert estimate.nu == pytest.approx(nu, abs=0.02), z


def test_without_wheel_speeds_the_model_predicts_speed_and_uncertainty():
    """The scale of the effort and the noise of every tick are random; the gyro and the start are exact."""
    runs, n = 300, 1000
    rng, std = np.random.default_rng(31), ACCEL_SCALE_STD
    # so that the scale belongs to the model
    imu = replace(IMU, gyro_noise_std=1e-6, gyro_bias_std=0.0, gyro_scale_std=0.0)
    reckon = reckoning(imu=imu, initial_std=np.full(6, 1e-6))
    u = np.column_stack([0.4 + 0.3 * np.sin(0.02 * np.arange(n)), np.zeros(n), np.zeros(n)])
    level = np.column_stack([np.zeros((n, 2)), np.full(n, 0.02)])  # the vehicle never turns
    kernel, errors = kernel_of(reckon), []
    belief, _ = kernel.run(make_ticks(reckon, {"imu": level}, u))
    for _ in range(runs):
        gain, nu, x = 1.0 + std * rng.standard_normal(), 0.0, 0.0
        for k in range(n):
            before, drag = nu, 1.2 / 0.61
            nu = nu * np.exp(-drag * DT) + gain * 1.5 * u[k, 0] / 1.2 * (1.0 - np.exp(-drag * DT))
            x += 0.5 * DT * (before + nu)
            nu += 1e-3 * rng.standard_normal()
        errors.append([x - belief.mean[0], nu - belief.mean[3]])
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], runs) / runs
    variances = np.mean(np.square(errors), axis=0) / np.diag(belief.cov)[[0, 3]]
    assert np.all((low < variances) & (variances < high)), f"x, ν_x: {variances} of the claimed variance"


def test_pose_nees_lies_in_its_band_on_the_independent_truth():
    """The truth has a dead zone, unequal motors, lag and slip that the model lacks; gyro and wheels are as modelled."""
    n, ticks, rng = 40, 800, np.random.default_rng(32)
    physics = draw_robots(n, 5)
    bias = np.zeros((n, 3))
    bias[:, 2] = 5e-4 * rng.standard_normal(n)
    physics = physics.with_parameters(imu=physics.imu.with_parameters(bias=bias, tilt_rad=np.zeros((n, 2))))
    small, wheels = load("small"), Wheels(track_m=0.12, noise_std=0.01)
    reckon = DeadReckoning(
        small.vehicle,
        sensors(imu=Imu(gyro_noise_std=0.004, gyro_scale_std=0.01), wheels=wheels),
        np.diag([5e-7, 2e-7, 6e-6, 1, 1, 1]),
    )
    gyro_scale, speed_scale = 1.0 + 0.01 * rng.standard_normal((2, n))
    u = 0.1 * np.sin(0.03 * np.arange(ticks))[:, None] + [0.75, 0.0, 0.0]
    u = u * [1.0, 0.0, 0.0] + np.outer(np.where(np.arange(ticks) // 200 % 2, 0.1, -0.1), [0.0, 0.0, 1.0])
    t_ns = tick_times(ticks, 1.0 / DT)
    motion = drive_group(physics, np.repeat(u[:, None], n, axis=1), range(n), t_ns, ROBOT_STEP_S)
    z, nu = (x.swapaxes(0, 1) for x in (motion.readings, motion.truth[..., 3:6]))
    v = nu[..., :1] + nu[..., 2:] * [-0.06, 0.06]
    z[:, :, 2] *= gyro_scale[:, None]
    v = v * speed_scale[:, None, None] + 0.01 * rng.standard_normal(v.shape)
    kernel, nees, truth = kernel_of(reckon), 0.0, motion.truth[-1, :, :3]
    for i in range(n):
        belief, _ = kernel.run(make_ticks(reckon, {"imu": z[i], "wheels": v[i]}, u))
        e = truth[i] - belief.mean[:3]
        e[2] = wrap(e[2])
        nees += e @ np.linalg.solve(belief.cov[:3, :3], e)
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], 3 * n)
    assert low < nees < high, f"{nees / (3 * n):.2f} of what is claimed"


@pytest.mark.parametrize(
    "delay", [{"delay_s": 0.03, "delay_slots": 3}, {"low_pass_hz": 5.0}], ids=["delay", "low-pass"]
)
def test_a_delayed_gyro_causes_no_heading_error_in_a_curve(delay):
    """On a curve that begins, oscillates and ends, the delay causes no heading error during or after the curve."""
    n = 600
    reckon = reckoning(MODEL, imu=replace(IMU, **delay), odometer=ODOMETER)
    nu, eta = drive_truth(n, 4.0)
    fine = np.interp(np.arange(n * 10) * 1e-3, np.arange(n + 1) * DT, nu[:, 2])
    if "delay_s" in delay:
        delayed_signal = np.concatenate([np.zeros(30), fine[:-30]])
    else:
        delayed_signal, tau_s = np.zeros_like(fine), 0.5 / (np.pi * 5.0)
        for k in range(1, len(fine)):
            delayed_signal[k] = fine[k] + (delayed_signal[k - 1] - fine[k]) * np.exp(-1e-3 / tau_s)
    z = np.column_stack(
        [np.zeros((n, 2)), 1.03 * np.append(delayed_signal[10::10], delayed_signal[-1]) + 0.02]
    )
    readings, driving = {"imu": z, "odometer": 1.02 * nu[1:, :1]}, np.full((n, 3), [0.1, 0.0, 0.0])
    _, estimates = kernel_of(reckon).run(make_ticks(reckon, readings, driving))
    assert np.max(np.abs(wrap(estimates.eta[:, 2] - eta[1:, 2]))) < 3e-3
    assert np.max(np.hypot(*(estimates.eta[:, :2] - eta[1:, :2]).T)) < 3e-3


def test_slow_readings_correct_the_model_error_between_two_readings():
    """Under no command the model slows down: without the last term of (3) the heading would end 1 rad short."""
    n = 2000
    reckon = reckoning(imu=IMU, odometer=ODOMETER)
    nu, eta = drive_truth(n, 15.0)
    z, v = np.full((n, 3), np.nan), np.full((n, 1), np.nan)
    z[9::10] = np.column_stack([np.zeros((n // 10, 2)), 1.03 * nu[10::10, 2] + 0.02])
    v[9::10] = 1.02 * nu[10::10, :1]
    belief, _ = kernel_of(reckon).run(make_ticks(reckon, {"imu": z, "odometer": v}))
    assert abs(wrap(belief.mean[2] - eta[-1, 2])) < 0.15


def test_a_gyro_without_accelerometers_turns_the_heading():
    reckon = reckoning(MODEL, imu=IMU)
    ticks = make_ticks(reckon, {"imu": np.tile([0.0, 0.0, 1.03 * 0.5], (200, 1))})
    missing = ticks.sensors.imu._replace(z=ticks.sensors.imu.z + np.array([np.nan, np.nan, 0.0]))
    heading = [
        kernel_of(reckon).run(t)[0].mean[2]
        for t in (ticks, ticks._replace(sensors=ticks.sensors._replace(imu=missing)))
    ]
    assert heading[0] > 0.5
    assert heading[1] == heading[0]


def test_sensor_rows_are_selected_by_their_measured_velocities():
    def rows_shown(**sensors_by_name):
        return [(r.name, r.rows, r.entries) for r in reckoning(**sensors_by_name).readings]

    assert rows_shown(imu=IMU) == [("imu", (2,), (2,))]
    assert rows_shown(wheels=WHEELS, imu=IMU) == [("imu", (2,), (2,)), ("wheels", (0, 1), (0,))]
    assert rows_shown(imu=IMU, odometer=ODOMETER, wheels=WHEELS) == [
        ("imu", (2,), (2,)),
        ("odometer", (0,), (0,)),
    ]
    assert rows_shown(wheels=WHEELS) == [("wheels", (0, 1), (0, 2))]
    assert rows_shown(pose=Pose(noise_std=np.full(3, 0.01)), odometer=ODOMETER) == [("odometer", (0,), (0,))]
    assert rows_shown(imu=IMU, odometer=ODOMETER, use=("odometer",)) == [("odometer", (0,), (0,))]
    with refused("field.use", ValueError, value="gps", valid="imu"):
        reckoning(use=("gps",))


def test_wheel_speeds_without_a_gyro_determine_the_heading():
    n = 500
    nu, eta = drive_truth(n, 1e9)
    z = WHEELS.radius_scale * np.stack([nu[1:, 0] - 0.06 * nu[1:, 2], nu[1:, 0] + 0.06 * nu[1:, 2]], 1)
    reckon = reckoning(MODEL, wheels=WHEELS)
    belief, _ = kernel_of(reckon).run(make_ticks(reckon, {"wheels": z}))
    np.testing.assert_allclose(belief.mean[:2], eta[-1, :2], atol=1e-3)
    assert abs(wrap(belief.mean[2] - eta[-1, 2])) < 1e-3


def test_the_sideways_velocity_of_a_car_follows_from_its_rear_axle():
    car = Car(
        wheelbase_m=0.15,
        rear_axle_m=0.075,
        throttle_gain=7.0,
        steering_gain=0.4,
        drivetrain=Drivetrain(commands=2),
    )
    reckon = reckoning(car, imu=IMU, odometer=ODOMETER)
    slots = type(reckon.sensors)(
        Slot(1.0, np.array([0.0, 0.0, 1.03 * 2.0 + 0.02])), Slot(1.0, np.array([1.02]))
    )
    _, estimate = reckon.step(reckon.init(), Tick(10_000_000, np.zeros(2), slots))
    np.testing.assert_allclose(estimate.nu, [1.0, 0.15, 2.0], atol=1e-12)
    assert estimate.cov[4, 4] == pytest.approx(0.075**2 * estimate.cov[5, 5], rel=0.02)


def test_position_uncertainty_after_a_pause_covers_the_possible_distance():
    reckon = compile_block(reckoning(imu=IMU, odometer=ODOMETER), "python")
    belief = reckon.init(nu=np.array([0.3, 0.0, 0.0]))
    slots = type(reckon.sensors)(Slot(1.0, np.array([0.0, 0.0, 0.02])), Slot(1.0, np.array([1.02 * 0.3])))
    belief, _ = reckon.step(belief, Tick(10_000_000, np.array([0.24, 0.0, 0.0]), slots))
    _, estimate = reckon.step(belief, Tick(60_010_000_000, np.array([0.24, 0.0, 0.0]), slots))
    assert estimate.eta[0] < 0.5
    assert np.sqrt(estimate.cov[0, 0]) > 0.3 * 55.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"initial_std": -np.ones(6)}, ("field.range", {"field": "DeadReckoning.initial_std", "low": 0.0})),
        (
            {"initial_std": np.zeros(9)},
            ("field.shape", {"field": "DeadReckoning.initial_std", "value": "(9,)", "expected": "(6,)"}),
        ),
    ],
)
def test_bad_settings_are_refused_with_a_reason(options, words):
    with refused(words[0], ValueError, **words[1]):
        reckoning(**options)


def test_a_gyro_measures_its_bias_at_rest_before_the_drive():
    """The bias differs from that of the file by 0.01 rad/s; without the rest the heading is 0.03 rad off after 3 s."""
    rest, n = 200, 300
    reckon = reckoning(MODEL, imu=IMU, odometer=ODOMETER)
    nu, eta = drive_truth(n, 2.0)
    nu, eta = (np.concatenate([np.zeros((rest, 3)), x]) for x in (nu, eta))
    z = np.column_stack([np.zeros((rest + n, 2)), 1.03 * nu[1:, 2] + 0.03])
    belief, estimates = kernel_of(reckon).run(make_ticks(reckon, {"imu": z, "odometer": 1.02 * nu[1:, :1]}))
    assert np.max(np.abs(wrap(estimates.eta[rest:, 2] - eta[rest + 1 :, 2]))) < 5e-3
    assert belief.cov[6, 6] < 0.2 * IMU.gyro_bias_std**2
    assert abs(belief.mean[6] - 0.01) < 4.0 * np.sqrt(belief.cov[6, 6])
