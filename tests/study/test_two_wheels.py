"""The independent robot: physics that a pencil gives, and nothing of the house in it."""

import ast
import inspect

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from baqueano.study import two_wheels
from baqueano.study.two_wheels import TwoWheels, drawn


def quiet(n=1, **changed):
    robots = drawn(n, 3)
    zero = {
        name: np.zeros_like(getattr(robots, name))
        for name in ("floor", "accel_bias", "gyro_bias", "imu_tilt_rad")
    }
    return robots.changed(**zero, accel_noise=0.0, gyro_noise=0.0, **changed)


def driven(robots, u, seconds):
    world = TwoWheels(robots, 0)
    for _ in range(round(100 * seconds)):
        z = world.tick(np.tile(u, (len(robots.mass_kg), 1)), 0.01)
    return world, z


def test_it_imports_nothing_of_the_physics_that_it_judges():
    tree = ast.parse(inspect.getsource(two_wheels))
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not [name for name in modules if name and name.startswith("baqueano")]


def test_straight_on_the_forces_balance_at_its_final_speed():
    same = {"gain": np.ones((1, 2)), "forward": np.full((1, 2), 0.3)}
    q = quiet(**same)
    world, _ = driven(q, [0.6, 0.0, 0.0], 4.0)
    duty = round(255 * 0.6) / 255 - 0.3

    def left_over(v):
        dry = q.dry_n[0] * np.tanh(v / q.dry_speed_m_s)
        return 2.0 * q.stall_n[0] * duty - dry - q.viscous[0] * v - q.quadratic[0] * v * v

    assert world.truth.nu[0, 0] == pytest.approx(brentq(left_over, 0.01, 2.0), rel=1e-6)


def test_below_its_dead_zone_it_stands():
    world, _ = driven(quiet(3), [0.2, 0.0, 0.0], 1.0)
    assert np.all(world.truth.eta == 0.0)


def test_on_a_steady_circle_the_imu_feels_the_centripetal_acceleration():
    q = quiet(imu_m=np.zeros((1, 2)))
    world, z = driven(q, [0.7, 0.0, 0.1], 4.0)
    v, _, w = world.truth.nu[0]
    assert z[0, 1] == pytest.approx(v * w, rel=0.01)
    assert z[0, 2] == pytest.approx(w)


def test_without_force_it_only_loses_energy():
    world, _ = driven(quiet(2), [0.8, 0.0, 0.2], 1.0)
    q, energy = world.robots, []
    for _ in range(150):
        world.tick(np.zeros((2, 3)), 0.01)
        vx, vy, w = world.truth.nu.T
        energy.append(0.5 * q.mass_kg * (vx**2 + (vy + q.ahead_m * w) ** 2) + 0.5 * q.inertia_kg_m2 * w**2)
    after = np.array(energy)[30:]  # the motors' lag is over
    assert np.all(np.diff(after, axis=0) <= 1e-12)


def test_its_step_is_fine_enough():
    q = quiet()
    world, _ = driven(q, [0.7, 0.0, -0.1], 0.5)
    other = TwoWheels(q, 0)
    other._sent_s[-1], other._sent[-1] = 0.0, [[0.7, 0.0, -0.1]]
    pieces = [(0.0, q.delay_s[0]), (q.delay_s[0], 0.5)]
    x = np.zeros(8)
    for start, end in pieces:
        duty = other._duty(0.5 * (start + end))
        rate = lambda t, x, duty=duty: other._rate(x[None], duty)[0]  # noqa: E731
        x = solve_ivp(rate, (start, end), x, rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(world.truth.nu[0], x[3:6], atol=2e-3)  # the delay is rounded to 1 ms


def test_a_higher_breakaway_needs_a_higher_command_to_start():
    for breakaway, moves in ((1.0, True), (1.3, False)):
        q = quiet(breakaway=np.full(1, breakaway), forward=np.full((1, 2), 0.3), dry_speed_m_s=0.005)
        world, _ = driven(q, [0.38, 0.0, 0.0], 2.0)
        assert (world.truth.eta[0, 0] > 0.01) == moves
