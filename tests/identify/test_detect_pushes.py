"""Sensitivity columns of model terms compared with vehicles that are really pushed."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, fit as module, identify, random_steps
from baqueano.identify.diagnostics.residual_checks import fit_residuals
from baqueano.identify.diagnostics.unmodelled_terms import fitted_motion, term_columns
from baqueano.identify.parameters.free import substitute
from baqueano.numerics.score_test import score_test, score_test_parts
from baqueano.simulate import simulate


@pytest.fixture(scope="module")
def end(case):
    """Two runs of a vehicle with friction that its file does not have, whose gyro and accelerometer have biases."""
    rough = case.with_values({"model.friction.coulomb": [1.0, 0.0, 60.0]})
    u = random_steps(case.command.limit, 6.0, 100.0, 5)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "fit_by_simulation", lambda task: task)
        return identify(
            [simulate(rough, u, 0), simulate(rough, u[::-1], 1)], case, options=FitOptions(at_rest=True)
        )


def push_response(blocks, record, push):
    """Return the sensor response and the speed (N, m + 1) of a vehicle that is pushed (N, 3)."""
    vehicle, outputs = blocks.model.init(), []
    for dt_s, u, a in zip(record.dt_s, record.u, push, strict=True):
        vehicle, motion = blocks.model.step(vehicle._replace(nu=vehicle.nu + a * dt_s), u, dt_s, np.zeros(3))
        motion = motion._replace(nu_dot=motion.nu_dot + a)
        outputs.append(np.concatenate([*(sensor.h(motion) for sensor in blocks.sensors), motion.nu[:1]]))
    return np.array(outputs)


@pytest.mark.parametrize(
    ("code", "axis", "phi"),
    [
        ("drag, x", 0, lambda nu: np.abs(nu[:, 0]) * nu[:, 0] / np.max(np.abs(nu[:, 0])) ** 2),
        ("dry friction, psi", 2, lambda nu: np.tanh(10.0 * nu[:, 2] / np.max(np.abs(nu[:, 2])))),
        ("sideways, y", 1, lambda nu: nu[:, 0] * nu[:, 2]),
    ],
)
def test_the_sensitivity_column_equals_the_response_to_a_small_push(end, code, axis, phi):
    problem, theta = end.task.problem, end.search.solution.theta
    now = fitted_motion(end.blocks, problem, theta)
    columns = [
        (D[k].ravel(), term.speed)
        for block, D in term_columns(end.blocks, problem, now)()
        for k, term in enumerate(block)
        if term.code == code
    ]
    row = first = 0
    for record, weight, index, motion in zip(
        problem.records, problem.weights, problem.layout.indices, now.motions, strict=True
    ):
        blocks = substitute(end.blocks, (*problem.shape.shared_paths, *problem.shape.per_run), theta[index])
        push = 1e-6 * phi(motion.nu)[:, None] * np.eye(3)[axis]
        slope = (push_response(blocks, record, push) - push_response(blocks, record, -push)) / 2e-6
        slope, speed = weight * slope[:, :-1], slope[:, -1]
        change, speed_change = (
            columns[0][0][row : row + slope.size],
            columns[0][1][first : first + len(speed)],
        )
        row, first = row + slope.size, first + len(speed)
        np.testing.assert_allclose(change.reshape(slope.shape), slope, atol=1e-5 * np.max(np.abs(slope)))
        np.testing.assert_allclose(speed_change, speed, atol=1e-5 * np.max(np.abs(speed)))


def test_testing_part_of_a_run_equals_testing_a_masked_column(end):
    problem, theta = end.task.problem, end.search.solution.theta
    identifiable = np.concatenate(
        [end.identifiability.mask, np.ones(problem.size - len(end.identifiability.mask), bool)]
    )
    residuals = fit_residuals(problem, theta, identifiable)
    rng, n = np.random.default_rng(0), len(residuals.run)
    masks = [np.arange(n) < 0.3 * n, residuals.run == 1, rng.random(n) < 0.5]
    assert residuals.nuisances  # biases
    for mask, answers in zip(masks, score_test_parts(residuals, masks), strict=True):
        present = np.repeat(mask, len(residuals.clipped_residuals) // n)
        D = (residuals.d * present).reshape(len(residuals.d), n, -1)
        for part, total in zip(answers, score_test(residuals, D), strict=True):
            np.testing.assert_allclose(part.size, total.size, rtol=1e-6)
            np.testing.assert_allclose([part.z, part.freedom], [total.z, total.freedom], rtol=1e-6)
            np.testing.assert_allclose(
                part.shift, total.shift, rtol=1e-6, atol=1e-9 * np.max(np.abs(total.shift))
            )


def test_the_score_test_ignores_a_diverged_probe(end):
    problem, theta = end.task.problem, end.search.solution.theta
    residuals = fit_residuals(problem, theta, np.ones(problem.size, bool))
    D = np.stack([residuals.d[0] ** 2, np.full(len(residuals.clipped_residuals), 1.0)])
    D[1, 50:] = np.inf
    sound, far_test = score_test(residuals, D.reshape(2, len(residuals.run), -1))
    assert sound.size != 0.0
    assert (far_test.size, far_test.z) == (0.0, 0.0)
    assert not far_test.shift.any()
