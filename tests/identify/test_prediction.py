"""The innovations of the small filter are those of the exact likelihood.

The oracle is the joint normal distribution of all measurements of a linear vehicle, computed as one mean and one
covariance matrix, without any filter.
"""

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify
from baqueano.identify.data.record import FittedBlocks, make_record
from baqueano.identify.estimation import prediction_error as prediction
from baqueano.identify.estimation.prediction_error import FilterNoise, Prediction, maximum_likelihood
from baqueano.identify.parameters.theta import ThetaShape
from baqueano.identify.residuals import innovations as prediction_kernel
from baqueano.identify.residuals.innovations import filter_kernel, noise_axes
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.statistics import chi_square_tail
from baqueano.simulate import simulate
from baqueano.simulate.excitation import random_steps
from baqueano.vehicle_file import load, parse
from tests.codes import of_code

MASS, DRAG, DT = 2.0, 3.0, 0.02
CART = f"""
format = 1
name = "cart"
rate_hz = 50.0
[command]
names = ["u_x", "u_y", "u_psi"]
limit = [10.0, 0.0, 0.0]
[model]
kind = "planar"
mass_kg = {MASS}
inertia_kg_m2 = 1.0
actuator_matrix = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]
process_noise_std = [0.2, 0, 0]
[model.friction]
linear = [{DRAG}, 1.0, 1.0]
[sensors.odometer]
kind = "odometer"
rate_hz = 50.0
noise_std = 0.1
"""
FREE = ("model.friction.linear[0]", "model.actuator_matrix[0,0]")
AT = np.array([DRAG, 1.0, 0.05, 0.03, 0.0, 0.0, 0.2])  # d, T, ν₀, v of three axes, ½ log q


@pytest.fixture(scope="module")
def cart():
    return parse(CART, "cart.toml")


@pytest.fixture
def gauss(monkeypatch):
    """Use the Gaussian likelihood, which does not reduce the weight of outliers."""
    monkeypatch.setattr(prediction_kernel, "GATE", 1e9)
    monkeypatch.setattr(prediction, "ROBUST_SCALE", 1e9)
    monkeypatch.setattr(prediction, "BETA", 1.0)


def cart_run(file, seed, ticks=60):
    return simulate(file, random_steps(file.command.limit, ticks * DT, 1.0 / DT, seed), seed)


def of_cart(file, *runs, start=(0,)):
    """Return a Prediction of the cart with a newly traced kernel, so that no cached kernel hides a patch."""
    blocks = FittedBlocks(file.vehicle, file.sensors)
    shape = ThetaShape(FREE, (), start, (False,))
    records = [make_record(run, file.sensors._asdict())._replace(run=k) for k, run in enumerate(runs)]
    problem = Residuals(blocks, shape, records)
    problem = problem.weight(np.array([0.1]))
    prediction = Prediction(problem, blocks)
    prediction.kernel = filter_kernel(blocks, shape, "auto")
    return prediction


def joint_normal(run, x):
    """Return mean (N,) and covariance (N, N) of the readings of an odometer on a line, in units of σ = 0.1."""
    drag, force, start, v, *_, half_log_q = x
    ratio = drag / MASS * DT
    a = 1.0 - ratio + ratio**2 / 2.0 - ratio**3 / 6.0 + ratio**4 / 24.0  # RK4
    b = (1.0 - a) / drag * force
    n = len(run.applied_commands)
    mean, speed = np.zeros(n), start
    for k in range(n):
        speed = a * speed + b * run.applied_commands[k, 0]
        mean[k] = speed
    powers = np.tril(a ** np.maximum(np.subtract.outer(np.arange(n), np.arange(n)), 0))
    cov = powers @ powers.T * v * DT / 0.01 + np.eye(n) * np.exp(2.0 * half_log_q)
    return mean / 0.1, cov


def log_likelihood(run, x):
    mean, cov = joint_normal(run, x)
    y = run.sensors["odometer"].z[:, 0] / 0.1 - mean
    return -0.5 * (y @ np.linalg.solve(cov, y) + np.linalg.slogdet(cov)[1])


def test_the_cost_is_minus_the_logarithm_of_the_joint_normal_density(cart, gauss):
    for seed in range(3):
        run = cart_run(cart, seed)
        assert of_cart(cart, run).evaluate(AT).cost == pytest.approx(-log_likelihood(run, AT), rel=1e-7)


def test_the_innovations_equal_the_innovations_of_filterpy(cart, gauss):
    from filterpy.kalman import KalmanFilter

    run, drag = cart_run(cart, 4), DRAG / MASS * DT
    a = 1.0 - drag + drag**2 / 2.0 - drag**3 / 6.0 + drag**4 / 24.0
    kf = KalmanFilter(dim_x=1, dim_z=1, dim_u=1)
    kf.x, kf.P, kf.F, kf.H = np.array([[AT[2]]]), np.zeros((1, 1)), np.array([[a]]), np.array([[10.0]])
    kf.B = np.array([[(1.0 - a) / DRAG]])
    kf.Q = np.array([[AT[3] * DT]])
    kf.R = np.array([[np.exp(2 * AT[6])]])
    innovations = []
    for u, z in zip(run.applied_commands[:, 0], run.sensors["odometer"].z[:, 0], strict=True):
        kf.predict(u=np.array([[u]]))
        kf.update(np.array([[z / 0.1]]))
        innovations.append(float(kf.y[0, 0] / np.sqrt(kf.S[0, 0])))
    assert np.allclose(of_cart(cart, run).derivatives(AT)[0].e[:, 0], innovations, rtol=1e-9, atol=1e-9)


def fisher_of(run, x, rows_shown):
    """Return the information (k, k) of the joint normal on the entries `rows_shown` of x."""
    _, cov = joint_normal(run, x)
    step, d_mean, d_cov = 1e-5 * np.maximum(np.abs(x), 0.1), [], []
    for k in rows_shown:
        forward, backward = x.copy(), x.copy()
        forward[k], backward[k] = x[k] + step[k], x[k] - step[k]
        (m1, c1), (m0, c0) = joint_normal(run, forward), joint_normal(run, backward)
        d_mean.append((m1 - m0) / (2 * step[k]))
        d_cov.append(np.linalg.solve(cov, (c1 - c0) / (2 * step[k])))
    return np.array(
        [[a @ np.linalg.solve(cov, b) + 0.5 * np.trace(A @ B) for b, B in zip(d_mean, d_cov, strict=True)]
         for a, A in zip(d_mean, d_cov, strict=True)]
    )  # fmt: skip


def test_errors_of_drag_and_floor_noise_equal_the_cramer_rao_bound(cart):
    """The decay of a push depends on both: their errors are correlated, and the error of the drag is larger."""
    u = 0.1 * random_steps(cart.command.limit, 16.0, 1.0 / DT, 12)
    run = simulate(cart, u, 12)
    fit = identify(run, cart, FREE, options=FitOptions(cost="innovations", diagnose=False))
    x = np.array([*fit.estimate[:2], 0.0, fit.estimate[2] ** 2, 0.0, 0.0, 0.0])
    bound = np.linalg.inv(fisher_of(run, x, [0, 1, 3, 6]))
    expected = bound[0, 2] / np.sqrt(bound[0, 0] * bound[2, 2])
    assert expected > 0.3
    assert fit.cov[0, 2] / (fit.std[0] * fit.std[2]) == pytest.approx(expected, abs=0.05)
    assert fit.std[0] == pytest.approx(np.sqrt(bound[0, 0]), rel=0.08)


def test_the_mean_curvature_of_the_cost_equals_the_fisher_information(cart, gauss):
    rows_shown = [0, 1, 2, 3, 6]
    runs = [cart_run(cart, 7)]
    (mean, cov), fisher = joint_normal(runs[0], AT), fisher_of(runs[0], AT, rows_shown)
    root, rng, H = np.linalg.cholesky(cov), np.random.default_rng(0), np.zeros((5, 5))
    prediction, draws = of_cart(cart, runs[0]), 300
    z = slice(4, 5)
    for _ in range(draws):
        drawn_z = 0.1 * (mean + root @ rng.standard_normal(len(mean)))[:, None]
        prediction.simulation = prediction.simulation.with_columns(z, [drawn_z])
        H += prediction.evaluate(AT).hessian[np.ix_(rows_shown, rows_shown)] / draws
    scale = np.sqrt(np.diagonal(fisher))
    assert np.allclose(H / np.outer(scale, scale), fisher / np.outer(scale, scale), atol=0.05)


def test_innovations_without_floor_noise_equal_simulation_errors(cart):
    prediction = of_cart(cart, cart_run(cart, 1))
    x = prediction.x(AT[:3])
    assert np.allclose(prediction.derivatives(x)[0].e, prediction.simulation.residuals(AT[:3])[0], atol=1e-12)


def test_the_gradient_matches_finite_differences_over_two_runs_with_outliers(cart):
    runs = [cart_run(cart, seed) for seed in (2, 3)]
    runs[0].sensors["odometer"].z[::7] += 3.0
    prediction = of_cart(cart, *runs)
    x = np.array([2.8, 1.1, 0.05, -0.1, 0.02, 0.0, 0.0, 0.3])
    slope = prediction.evaluate(x).gradient
    for k in (0, 1, 2, 3, 4, 7):
        forward, backward = x.copy(), x.copy()
        forward[k], backward[k] = x[k] + 1e-6, x[k] - 1e-6
        slope_difference = (prediction.evaluate(forward).cost - prediction.evaluate(backward).cost) / 2e-6
        assert slope[k] == pytest.approx(slope_difference, rel=1e-5, abs=1e-4)


def test_a_spike_has_the_same_effect_as_a_missing_measurement(cart):
    sound_run, spiked_run, gap = (cart_run(cart, 5) for _ in range(3))
    spiked_run.sensors["odometer"].z[20] = 1e6
    gap.sensors["odometer"].z[20] = np.nan
    innovations = [of_cart(cart, run).derivatives(AT)[0].e[:, 0] for run in (sound_run, spiked_run, gap)]
    assert innovations[2][20] == 0.0
    assert np.allclose(np.delete(innovations[1], 20), np.delete(innovations[2], 20), atol=1e-9)
    assert not np.allclose(innovations[0][21:25], innovations[2][21:25], atol=1e-3)


def test_floor_noise_and_sensor_noise_are_identified(cart):
    prediction = of_cart(cart, cart_run(cart, 11, 1200))
    low, high = np.array([0.0, -10.0, -np.inf]), np.full(3, np.inf)
    likely = maximum_likelihood(prediction, np.array([DRAG, 1.0, 0.0]), low, high, np.zeros(3, bool))
    v, std = likely.noise.floor[0], likely.floor_std[0]
    assert likely.solution.converged
    assert abs(v - 0.04) < 4.0 * std < 0.04
    assert np.exp(likely.noise.sensors[0]) == pytest.approx(1.0, abs=0.15)
    assert likely.noise.floor[1:] == pytest.approx([0.0, 0.0])  # the odometer does not measure them
    assert likely.p_value < 1e-6
    white = np.concatenate([s.e for s in prediction.derivatives(prediction.x(likely.theta, likely.noise))])
    assert np.std(white) == pytest.approx(1.0, abs=0.1)


def test_without_floor_noise_the_likelihood_ratio_is_small(cart):
    quiet_cart = cart.with_values({"model.process_noise_std": [0.0, 0.0, 0.0]})
    ratios = []
    for seed in range(8):
        prediction = of_cart(cart, cart_run(quiet_cart, seed, 600))
        low, high = np.array([0.0, -10.0, -np.inf]), np.full(3, np.inf)
        ratios.append(
            maximum_likelihood(prediction, np.array([DRAG, 1.0, 0.0]), low, high, np.zeros(3, bool)).ratio
        )
    assert min(ratios) > -1e-6
    assert max(ratios) < 10.8  # one in a thousand of χ² with one degree
    assert np.median(ratios) < 1.5


def test_pose_covariance_grows_with_distance_and_innovations_are_white():
    camera = '[sensors.camera]\nkind = "pose"\nrate_hz = 4.0\nnoise_std = [0.01, 0.01, 0.01]'
    file = parse(CART[: CART.index("[sensors")] + camera, "camera.toml")
    blocks = FittedBlocks(file.vehicle, file.sensors)
    run = simulate(file, random_steps(file.command.limit, 60.0, 20.0, 3), 3)
    sample_fraction = (
        make_record(run, file.sensors._asdict()).sensors["camera"].sample_fraction is not None,
    )
    problem = Residuals(
        blocks,
        ThetaShape(FREE, (), (0,), sample_fraction),
        [make_record(run, file.sensors._asdict())],
        "python",
    )
    problem = problem.weight(np.full(3, 0.01))
    prediction = Prediction(problem, blocks)
    moving = FilterNoise(np.array([0.04, 0.0, 0.0]), np.zeros(3))
    e = prediction.derivatives(prediction.x(np.array([DRAG, 1.0, 0.0]), moving))[0].e
    present = problem.masks[0] > 0.0
    assert np.std(e[present[:, 0], 0]) == pytest.approx(1.0, abs=0.15)
    innovations = prediction.derivatives(prediction.x(np.array([DRAG, 1.0, 0.0])))[0].e
    assert np.std(innovations[present[:, 0], 0]) > 5.0


def test_a_kinematic_vehicle_cannot_use_the_innovations_cost():
    kinematic = parse(
        CART.replace('kind = "planar"', 'kind = "kinematic"')
        .replace(f"mass_kg = {MASS}\ninertia_kg_m2 = 1.0\nactuator_matrix", "velocity_matrix")
        .replace(f"[model.friction]\nlinear = [{DRAG}, 1.0, 1.0]\n", ""),
        "kinematic.toml",
    )
    with pytest.raises(UsageError, check=of_code("cost.no-velocity")):
        noise_axes(kinematic.vehicle)
    assert noise_axes(load("car").vehicle) == (0, 2)


def test_the_tail_probability_equals_the_chi_square_tables():
    for degrees, ratio in ((1, 10.828), (2, 13.816), (3, 16.266)):
        assert chi_square_tail(ratio, degrees) == pytest.approx(1e-3, rel=1e-3)
        assert chi_square_tail(0.0, degrees) == 1.0


def test_the_constants_of_the_robust_cost_are_correct_for_normal_errors():
    x = np.linspace(-12.0, 12.0, 200_001)
    density = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi) * (x[1] - x[0])
    psi = x * prediction.weight(x)
    assert np.sum(psi * x * density) == pytest.approx(prediction.BETA, rel=1e-6)
    assert np.sum(psi**2 * density) / np.sum(prediction.psi_derivative(x) * density) == pytest.approx(
        prediction.TAU, rel=1e-6
    )
    assert np.allclose(np.gradient(prediction.rho(x), x)[1:-1], psi[1:-1], atol=1e-6)
