"""Q and R are always symmetric positive definite, and correct if the truth is known.

Standard deviations from 6,000 samples scatter by 0.9 %; the bands are five times wider."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import lfilter

from baqueano.errors import UsageError
from baqueano.estimators import Ekf
from baqueano.estimators.augmented.state import layout
from baqueano.identify import excitation, identify, measure_noise, random_steps
from baqueano.identify.noise.covariances import positive_definite, unfitted_covariance
from baqueano.identify.noise.filter_noise import (
    MIN_READINGS,
    MIN_RESIDUALS,
    _free_noise,
    _rms_forward_command,
    _rounding,
    _straight_drive,
    _with_accelerometer_misfit,
    _with_noise,
)
from baqueano.identify.result.fit_result import ChannelFit
from baqueano.numerics.gaussian_likelihood import log_det_and_square
from baqueano.numerics.quasi_newton import minimise_logarithms
from baqueano.runs.run import Channel
from baqueano.simulate import simulate
from baqueano.vehicle_file import Provenance, load, parse
from tests.codes import of_code, refused
from tests.ekf_file import with_ekf


@settings(max_examples=100)
@given(matrix=arrays(float, (4, 4), elements=st.floats(-1e6, 1e6)), exponent=st.integers(-12, 3))
def test_any_matrix_is_converted_to_a_valid_covariance(matrix, exponent):
    notes = []
    Q = positive_definite(matrix, np.full(4, 10.0**exponent), "Q", notes)
    assert np.array_equal(Q, Q.T)
    d = np.sqrt(np.diagonal(Q))
    assert np.linalg.eigvalsh(Q / np.outer(d, d))[0] > 0.0
    assert np.all(np.diagonal(Q) >= 10.0**exponent * (1.0 - 1e-9))
    np.linalg.cholesky(Q)


def test_an_indefinite_matrix_is_corrected_and_reported():
    matrix = np.array([[1.0, 1.2, 0.0], [1.2, 1.0, 0.0], [0.0, 0.0, -1e-5]])
    notes = []
    Q = positive_definite(matrix, np.full(3, 1e-8), "Q", notes)
    np.linalg.cholesky(Q)
    assert [(note.code, note.subject) for note in notes] == [
        ("noise.raised", "Q"),
        ("noise.correlations-reduced", "Q"),
    ]
    assert notes[0].figures == {"count": 1, "total": 3}


def test_a_valid_covariance_is_unchanged():
    A = np.random.default_rng(0).normal(size=(50, 3))
    Q = np.cov(A.T)
    np.testing.assert_allclose(positive_definite(Q, np.full(3, 1e-9), "Q", []), Q, rtol=1e-12)


@pytest.fixture(scope="module")
def small(small):
    return with_ekf(small)


@pytest.fixture(scope="module")
def noise_at_rest(small):
    u = excitation("random_steps", small.command.limit, 60.0, 100.0, 4, rest_s=4.0)
    run = simulate(small, u, 4)
    return run, identify(run, small)


def test_a_sensor_without_a_field_for_its_noise_is_refused(noise_at_rest):
    run, fit = noise_at_rest
    fit_of_student = SimpleNamespace(file=SimpleNamespace(sensors=(*fit.file.sensors, object())))
    with refused("noise.no-field", UsageError):
        measure_noise.__wrapped__(fit_of_student, run)


def test_the_identified_noise_equals_the_sensor_noise_in_motion_and_at_rest(noise_at_rest):
    noise = measure_noise(noise_at_rest[1], noise_at_rest[0])
    std = np.sqrt(np.diagonal(noise.in_motion["imu"]))
    np.testing.assert_allclose(std, [0.1, 0.1, 0.004], rtol=0.08)  # the floor noise adds a little
    resting = noise.at_rest["imu"]
    np.testing.assert_allclose(np.sqrt(np.diagonal(resting)), [0.1, 0.1, 0.004], rtol=0.2)


def test_process_noise_from_the_truth_equals_the_simulated_noise(noise_at_rest, small):
    noise = measure_noise(noise_at_rest[1], noise_at_rest[0], source="truth")
    kick = small.vehicle.process_noise_std * np.sqrt(0.01)
    ratio = np.sqrt(np.diagonal(noise.process))[[0, 2]] / kick[[0, 2]]
    assert np.all((ratio > 0.9) & (ratio < 1.4))  # parameter errors increase the value
    assert noise.source == "truth"


def test_process_noise_from_innovations_is_within_a_factor_of_three(noise_at_rest, small):
    noise = measure_noise(noise_at_rest[1], noise_at_rest[0], source="innovations")
    np.linalg.cholesky(noise.process)
    assert noise.source == "innovations"
    kick = small.vehicle.process_noise_std[2] * np.sqrt(0.01)
    assert 0.3 * kick < np.sqrt(noise.process[2, 2]) < 3.0 * kick


def test_the_filter_of_the_file_uses_the_identified_noise(noise_at_rest, small):
    run, fit = noise_at_rest
    noise = measure_noise(fit, run)
    file = noise.updated_file(fit.vehicle_file, run.name)
    assert isinstance(file.estimator(), Ekf)
    np.testing.assert_allclose(file.sensors.imu.cov, noise.in_motion["imu"], rtol=1e-2)
    np.testing.assert_allclose(file.estimator().process_noise_cov, noise.process, rtol=1e-2, atol=1e-12)
    assert {row["name"] for row in noise.rows()} >= {"imu[0]", "nu_x", "nu_dot_psi"}
    assert "R of (ν, ν̇) per tick at 100 Hz" in noise.table()


@given(seed=st.integers(0, 10**6), m=st.integers(1, 5))
def test_log_determinant_and_distance_equal_numpy(seed, m):
    rng = np.random.default_rng(seed)
    A, y = rng.normal(size=(m + 3, m)), rng.normal(size=m)
    S = A.T @ A + 0.01 * np.eye(m)
    mask = rng.random(m) < 0.7
    log_det, square = log_det_and_square(S, np.where(mask, y, np.nan), np.where(mask, 1.0, 0.0))
    S, y = S[np.ix_(mask, mask)], y[mask]
    assert log_det == pytest.approx(np.linalg.slogdet(S)[1], abs=1e-9)
    assert square == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-9)


def test_the_search_follows_a_narrow_valley_to_its_minimum():
    q = minimise_logarithms(
        lambda x: float(np.sum((x - [1.0, -2.0]) ** 2)), np.zeros(2), np.full(2, -5.0), np.full(2, 5.0)
    )
    np.testing.assert_allclose(q, [1.0, -2.0], atol=0.01)


def test_noise_from_the_truth_needs_a_truth(noise_at_rest):
    run, fit = noise_at_rest
    with pytest.raises(UsageError, check=of_code("noise.no-truth")):
        measure_noise(fit, replace(run, truth=None), source="truth")
    with pytest.raises(UsageError, check=of_code("noise.unknown-source")):
        measure_noise(fit, run, source="guess")


def test_unused_channels_retain_the_noise_of_the_file(noise_at_rest, small):
    fit = identify(noise_at_rest[0], small, use=["imu[2]"])
    noise = measure_noise(fit, noise_at_rest[0], source="truth")
    np.testing.assert_allclose(noise.in_motion["imu"], small.sensors.imu.cov)
    assert "noise.of-the-file" in [note.code for note in noise.notes]


def test_an_unused_channel_without_stated_noise_uses_its_noise_at_rest(noise_at_rest, small):
    run = noise_at_rest[0]
    silent = {"sensors.imu.accel_noise_std": [0.0, 0.0], "sensors.imu.gyro_noise_std": 0.0}
    file = small.with_values(silent)
    noise = measure_noise(identify(run, file, use=["imu[2]"]), run, source="truth")
    np.testing.assert_allclose(np.sqrt(np.diagonal(noise.in_motion["imu"])), [0.1, 0.1, 0.004], rtol=0.25)
    simulated_imu = noise.updated_file(file).sensors.imu
    np.testing.assert_allclose(simulated_imu.accel_noise_std, [0.1, 0.1], rtol=0.25)
    assert ("noise.of-its-rest", "imu[0]") in [(note.code, note.subject) for note in noise.notes]


def test_the_source_of_the_noise_of_an_unused_channel_is_stated(noise_at_rest, small):
    run = noise_at_rest[0]
    file = small.with_values({"sensors.imu.accel_noise_std": [0.0, 0.0]})
    always_driven = replace(
        run, applied_commands=np.where(run.t_ns[:, None] >= 0, 1e-6, 0.0) + run.applied_commands
    )
    z = run.sensors["imu"].z.copy()
    z[:, 1] = np.nan
    imu = run.sensors["imu"]._replace(z=z)
    noise = measure_noise(
        identify(run, file, ["model.mass_kg"], use=["imu[2]"]),
        replace(always_driven, sensors={**run.sensors, "imu": imu}),
        source="truth",
    )
    notes = [(note.code, note.subject) for note in noise.notes]
    assert ("noise.of-its-readings", "imu[0]") in notes
    assert ("noise.without-readings", "imu[1]") in notes


def test_the_noise_of_an_unfitted_sensor_is_never_zero(noise_at_rest, small):
    run, rng = noise_at_rest[0], np.random.default_rng(0)
    t_ns, v = run.sensors["imu"].t_ns, rng.normal(0.0, 0.02, (len(run.sensors["imu"].t_ns), 1))
    run = replace(run, sensors={**run.sensors, "odometer": Channel(t_ns, t_ns, v + run.truth.nu[:, :1])})
    with_odometer = parse(small.text + '\n[sensors.odometer]\nkind = "odometer"\n', "small")
    noise = measure_noise(identify(run, with_odometer, ["model.mass_kg"], use=["imu"]), run, source="truth")
    assert np.sqrt(noise.in_motion["odometer"][0, 0]) == pytest.approx(0.02, rel=0.2)
    sensors = noise.updated_file(with_odometer).sensors
    assert sensors.odometer.cov[0, 0] > 0.0
    assert sensors.odometer.noise_std == pytest.approx(0.02, rel=0.2)
    np.testing.assert_array_equal(sensors.imu.accel_noise_std, small.sensors.imu.accel_noise_std)


def test_the_noise_of_a_channel_without_rest_is_estimated_from_differences(small):
    u = np.tile([0.6, 0.0, 0.0], (300, 1))
    run, notes = simulate(small, u, 1), []
    Q = unfitted_covariance(
        "imu", replace(small.sensors.imu, accel_noise_std=np.zeros(2)), np.zeros(3), [run], notes
    )
    np.testing.assert_allclose(np.sqrt(np.diagonal(Q)), [0.1, 0.1, 0.004], rtol=0.2)
    resting = replace(run, sensors={"imu": run.sensors["imu"]._replace(z=np.zeros((len(run.t_ns), 3)))})
    Q = unfitted_covariance(
        "imu", replace(small.sensors.imu, accel_noise_std=np.zeros(2)), np.zeros(3), [resting], notes
    )
    assert Q[0, 0] == 1.0


def test_the_noise_does_not_depend_on_the_names_of_the_runs(small):
    runs = [
        simulate(small, random_steps(small.command.limit, 10.0, small.rate_hz, seed), seed) for seed in (1, 2)
    ]
    renamed_runs = [replace(run, name=f"run {k}") for k, run in enumerate(runs)]
    noise, noise_of_copy = (
        measure_noise(identify(r, small, ["model.mass_kg"]), r) for r in (runs, renamed_runs)
    )
    assert runs[0].name == runs[1].name
    np.testing.assert_array_equal(noise.in_motion["imu"], noise_of_copy.in_motion["imu"])


def test_few_velocities_of_a_truth_give_no_noise_of_a_truth(small):
    run = simulate(small, random_steps(small.command.limit, 10.0, small.rate_hz, 1), 1)
    sparse_run = replace(run, truth=type(run.truth)(*(column[::50] for column in run.truth)))
    noise = measure_noise(identify(sparse_run, small, ["model.mass_kg"], use=["truth", "imu"]), sparse_run)
    assert list(noise.in_motion) == ["imu"]


def test_a_fit_of_one_of_two_sensors_gives_the_noise_of_both():
    car = load("car")
    run = simulate(car, random_steps([0.5, 0.8], 10.0, car.rate_hz, 0))
    noise = measure_noise(identify(run, car, ["model.throttle_gain"], use=["odometer"]), run)
    units = {row["name"]: (row["unit"], row["std_at_rest"]) for row in noise.rows()}
    assert units["imu[2]"] == ("rad/s", None)


TAGS = '\n[sensors.tags]\nkind = "tags"\npoints_m = [[0.5, 0.0], [-0.5, 0.0]]\n'
FORWARD = ["disturbance_std[0]", "disturbance_fade_s[0]", "velocity_walk_std[0]"]
NOISE = [f"sensors.tags.measurement_noise_cov[{i},{i}]" for i in (0, 1)]


def test_the_drag_is_that_at_the_command_of_the_runs():
    """A drive of 1 s at the rms command ends near its steady speed, where the drag is 2 d_c ν + d_l."""
    small = load("small").with_values({"model.friction.quadratic": [2.0, 0.0, 0.0]})
    runs = [SimpleNamespace(applied_commands=np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.1], [-0.8, 0.0, 0.0]]))]
    command = _rms_forward_command(runs)
    assert command == pytest.approx(np.sqrt(0.5))
    nu, decay_rate = _straight_drive(
        SimpleNamespace(blocks=SimpleNamespace(model=small.vehicle), file=small), command
    )
    friction, m = small.vehicle.friction, small.vehicle.mass_kg
    drag = friction.linear[0] + 4.0 * nu[0]
    dry = friction.coulomb[0] / friction.coulomb_speed[0] / np.cosh(nu[0] / friction.coulomb_speed[0]) ** 2
    assert nu[0] > 0.1
    assert decay_rate == pytest.approx((drag + dry) / m, rel=1e-3)
    assert _rms_forward_command([SimpleNamespace(applied_commands=np.zeros((3, 2)))]) == 0.0


@pytest.mark.parametrize("decay_rate", [0.5, 20.0])
def test_an_accelerometer_shows_a_push_against_the_drag(decay_rate):
    """d fades in 1 s, and v̇ = d − λ v. With λ = 20 1/s the push changes the speed within 50 ms, and then not v̇."""
    d, e = pushed_speed(0.4, decay_rate, np.random.default_rng(5), 60_000)
    r = d - decay_rate * e + 0.03 * np.random.default_rng(6).standard_normal(len(d))
    assert push_std_of([r], decay_rate) == pytest.approx(0.4, rel=0.2)


@pytest.mark.parametrize("push_std", [0.01, 0.3])
def test_errors_that_the_commands_cause_are_no_push(push_std):
    """The sensor has a wrong scale and place, the motors another lag, and the speed in bends an error."""
    rng, t_s = np.random.default_rng(7), 0.01 * np.arange(6000)
    v, w = driven_speeds(rng)
    e, a = pushed_speed(push_std, 6.0, rng)[1] + 0.1 * v - 0.006 * np.abs(w), np.gradient(v, t_s)
    r = np.gradient(e, t_s) + 0.05 * a + 0.003 * w**2 + 0.1 * np.roll(a, 5) + 0.03 * rng.standard_normal(6000)
    r_y = w * e - 0.02 * v * w + 0.02 * a + 0.1 * w * np.roll(v, 5) + 0.03 * rng.standard_normal(6000)
    assert push_std_of([r, r_y, 0.0], 6.0, (a, v * w, w)) == pytest.approx(push_std, rel=0.25, abs=0.005)


def test_the_sideways_accelerometer_shows_a_push_that_the_noise_of_the_forward_one_hides():
    """With d of 0.02 m/s² behind a drag of 6 1/s, the change of v is 0.02 m/s², but in a turn of 4 rad/s a_y contains
    4 v."""
    push_stds = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        (v, w), (d, e) = driven_speeds(rng), pushed_speed(0.02, 6.0, rng)
        noise, h = 0.1 * rng.standard_normal((2, 6000)), (np.gradient(v, 0.01), v * w, w)
        push_stds.append(push_std_of([d - 6.0 * e + noise[0], w * e + noise[1], 0.0], 6.0, h))
    assert np.sqrt(np.mean(np.square(push_stds))) == pytest.approx(0.02, rel=0.2)


def driven_speeds(rng):
    """Return the speeds (2, 6000) of a drive of random steps."""
    steps = np.repeat(rng.uniform(-1.0, 1.0, (120, 2)), 50, axis=0)
    return lfilter([0.06], [1.0, -0.94], steps * [0.4, 8.0], axis=0).T


def pushed_speed(push_std, decay_rate, rng, count=6000):
    """Return a push d (count,) that fades in 1 s, and the speed e (count,) of ė = d − λ e."""
    fade, decay = np.exp(-0.01), np.exp(-decay_rate * 0.01)
    d = lfilter([1.0], [1.0, -fade], push_std * np.sqrt(1.0 - fade**2) * rng.standard_normal(count))
    return d, lfilter([(1.0 - decay) / decay_rate], [1.0, -decay], d)


def push_std_of(residuals, decay_rate, predictions=(0.0,)):
    """Return the standard deviation of the push that the residuals (N,) of each entry of the IMU show. `predictions`
    are those of the entries; the first one is the forward accelerometer."""
    t_s = 0.01 * np.arange(len(residuals[0]))
    pairs = [
        (r + np.zeros(len(t_s)), h + np.zeros(len(t_s))) for r, h in zip(residuals, predictions, strict=True)
    ]
    channels = [ChannelFit("a", "imu", i, t_s, h + r, h, 1.0, 0.0, 0.0) for i, (r, h) in enumerate(pairs)]
    ekf, fit = load("small").estimator(use=("imu",)), SimpleNamespace(channels_by_run=[channels])
    return _with_accelerometer_misfit(ekf, fit, {"imu"}, decay_rate).disturbance_std[0]


def test_white_noise_of_an_accelerometer_leaves_a_push_of_the_size_of_its_error():
    """One minute of white noise of 0.1 m/s² hides pushes up to about 0.03 m/s² behind a drag of 6 1/s. A filter must
    allow for such pushes in each run.
    """
    noise = [0.1 * np.random.default_rng(seed).standard_normal(6000) for seed in range(40)]
    push_std = np.array([push_std_of([r], 6.0) for r in noise])
    assert np.min(push_std) > 0.01
    assert np.max(push_std) < 0.04  # with every fifth lag and no error: 0.0001 to 0.056


@pytest.mark.parametrize(
    ("tags", "free"),
    [
        (0, []),
        (MIN_READINGS, FORWARD[:1]),
        (MIN_RESIDUALS - 1, FORWARD[:1]),
        (MIN_RESIDUALS, [*FORWARD, "velocity_walk_std[1]", *NOISE]),
    ],
)
def test_few_readings_identify_the_misfit_but_not_the_sensor_noise(tags, free):
    ekf = parse(load("small").text + TAGS, "small").estimator(use=("imu", "tags"))
    paths = {parameter.path for parameter in _free_noise(ekf, {"imu"}, {}, {"imu": 6000, "tags": tags})}
    turning = {"disturbance_std[1]", "disturbance_fade_s[1]", "velocity_walk_std[2]", "motor_lag_std_s"}
    of_imu = {path for path in paths if path.startswith("sensors.imu")}
    assert turning <= paths
    assert paths - turning - of_imu == set(free)


def test_the_noise_of_a_counted_speed_is_at_least_its_step():
    """Readings that never repeat do not show a step. A tag, which repeats its position, is not treated as counted."""
    text = load("small").text + TAGS + '\n[sensors.odometer]\nkind = "odometer"\n'
    slots = layout(parse(text, "small").estimator(use=("imu", "odometer", "tags")))
    rng = np.random.default_rng(3)
    speed, tags = rng.uniform(0.0, 1.0, (600, 1)), 0.5 * rng.choice([-1.0, 1.0], (600, 2))
    imu = 0.01 * np.rint(100.0 * rng.standard_normal((600, 3)))

    def rounding_of(z, steps_ms=None):
        """`steps_ms` (600,) are the intervals of rates that the import derived."""
        times = np.cumsum(20 * np.ones(600, int) if steps_ms is None else steps_ms) * 1_000_000
        middle = times - np.diff(times, prepend=0) // 2
        run = SimpleNamespace(
            sensors={n: Channel(middle, times, x) for n, x in zip(slots.names, (imu, z, tags), strict=True)},
            metadata={} if steps_ms is None else {"means": "odometer"},
        )
        return _rounding(slots, {"imu"}, [run])

    counts, delays = np.rint(speed / 0.04), np.cumsum(rng.uniform(0.9, 1.1, (600, 1)), axis=0)
    for z in (0.04 * counts, 0.04 * (delays + counts) - 0.04 * delays):  # the second with rounding errors
        assert rounding_of(z) == {("odometer", 0): (pytest.approx(0.04**2 / 12.0), np.inf)}
    assert rounding_of(speed) == {}
    steps_ms = rng.integers(17, 27, 600)
    varying = 0.0008 * np.rint(speed * steps_ms[:, None] / 0.8) / (1e-3 * steps_ms[:, None])
    one_count = (0.0008 / (1e-3 * np.median(steps_ms))) ** 2 / 12.0
    assert rounding_of(varying, steps_ms) == {("odometer", 0): (pytest.approx(one_count), np.inf)}
    assert rounding_of(varying).get(("odometer", 0), (0.0, np.inf))[0] < 0.1 * one_count


def test_no_noise_of_two_wheels_trusts_one_of_them():
    """A wrong track changes both oppositely, and their mean, the speed, does not change."""
    text = load("small").text + '\n[sensors.wheels]\nkind = "wheels"\ntrack_m = 0.12\nnoise_std = 0.004\n'
    ekf = parse(text, "small").estimator(use=("imu", "wheels"))
    free = _free_noise(ekf, {"imu"}, {}, {"imu": 6000, "wheels": 6000})
    x = np.random.default_rng(4).uniform(-9.0, 0.0, len(free))
    (left, pair), (_, right) = _with_noise(ekf, free, x).sensors.wheels.cov
    mean, turn = (np.exp(2.0 * x[k]) for k, single in enumerate(free) if ".wheels." in single.path)
    assert left == right
    assert (0.5 * (left + pair), 0.5 * (left - pair)) == (pytest.approx(mean), pytest.approx(turn))


def test_a_sensor_quieter_than_its_noise_in_the_file_is_reported_only_if_this_noise_was_measured(small):
    """A file of the garage contains typical noise. A quiet chip on a smooth floor is not an error."""
    file = small.with_values({"sensors.imu.accel_noise_std": [0.015, 0.015]})
    run = simulate(file, excitation("random_steps", small.command.limit, 20.0, 100.0, 4), 4)
    key = "sensors.imu.measurement_noise_cov"
    origin = {key: Provenance("0001-experiment", verdict="USABLE")}
    measured_file = small.with_values({key: small.sensors.imu.cov.tolist()}, origin)
    assert "file.quiet" not in {reason.code for reason in identify(run, small).reasons}
    assert "file.quiet" in {reason.code for reason in identify(run, measured_file).reasons}
