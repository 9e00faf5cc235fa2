"""The independent truth: physics that agree with hand calculations and with a finer integrator, without code of the
package.
"""

import ast

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from baqueano.study import truth
from baqueano.study.truth import Transmission, TruthWorld, draw_cars, draw_robots


def without_noise(vehicles, **parts):
    silent = {name: 0.0 * getattr(vehicles.imu, name) for name in ("bias", "noise", "tilt_rad")}
    return vehicles.with_parameters(
        floor=0.0 * vehicles.floor, **{"imu": vehicles.imu.with_parameters(**silent), **parts}
    )


def robots(n=1, **parts):
    return without_noise(draw_robots(n, 3), **parts)


def cars(n=1, **parts):
    return without_noise(draw_cars(n, 3), **parts)


def drive_truth(vehicles, u, seconds):
    n = len(vehicles.mass_kg)
    world = TruthWorld(vehicles, range(n))
    for _ in range(round(100 * seconds)):
        z = world.tick(np.tile(u, (n, 1)), 0.01)
    return world, z


def test_the_independent_truth_imports_no_other_baqueano_module():
    from pathlib import Path

    for path in Path(truth.__file__).parent.glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        modules += [
            alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names
        ]
        own_modules = [name for name in modules if name.startswith("baqueano")]
        assert all(name.startswith("baqueano.study.truth") for name in own_modules), path.name


def test_forces_balance_at_the_final_speed_of_straight_driving():
    q = robots(gain=np.ones((1, 2)), forward=np.full((1, 2), 0.3))
    world, _ = drive_truth(q, [0.6, 0.0, 0.0], 2.0)
    duty = round(255 * 0.6) / 255 - 0.3

    def remainder(v):
        dry = q.dry[0, 0] * np.tanh(v / q.dry_speed_m_s[0])
        return 2.0 * q.stall_n[0] * duty - dry - q.viscous[0, 0] * v - q.quadratic[0, 0] * v * v

    assert world.truth.nu[0, 0] == pytest.approx(brentq(remainder, 0.01, 2.0), rel=1e-4)


def test_a_robot_rests_below_its_dead_zone():
    world, _ = drive_truth(robots(3), [0.2, 0.0, 0.0], 0.2)
    assert np.all(world.truth.eta == 0.0)


def test_the_imu_measures_the_centripetal_acceleration_on_a_circle():
    q = robots()
    world, z = drive_truth(
        q.with_parameters(imu=q.imu.with_parameters(place_m=np.zeros((1, 2)))), [0.7, 0.0, 0.1], 1.0
    )
    v, _, w = world.truth.nu[0]
    assert z[0, 1] == pytest.approx(v * w, rel=0.01)
    assert z[0, 2] == pytest.approx(w)


LOSSES = {"grip_n": np.full(2, 0.6), "play_m": np.full(2, 0.004), "second_lag_s": np.full(2, 0.03)}


@pytest.mark.parametrize("losses", [{}, LOSSES], ids=["ideal", "with grip limit, backlash and motor lag"])
def test_without_force_a_robot_only_loses_energy(losses):
    world, _ = drive_truth(with_transmission(robots(2), **losses), [0.8, 0.0, 0.2], 0.5)
    q, energy = world.physics, []
    for _ in range(70):
        world.tick(np.zeros((2, 3)), 0.01)
        vx, vy, w = world.truth.nu.T
        energy.append(0.5 * q.mass_kg * (vx**2 + (vy + q.ahead_m * w) ** 2) + 0.5 * q.inertia_kg_m2 * w**2)
    after = np.array(energy)[45 if losses else 30 :]  # the lags are over, and the wheels roll again
    assert np.all(np.diff(after, axis=0) <= 1e-12)


def test_a_higher_breakaway_needs_a_higher_command_to_start():
    q = robots(
        2, breakaway=np.array([1.0, 1.3]), forward=np.full((2, 2), 0.3), dry_speed_m_s=np.full(2, 0.005)
    )
    world, _ = drive_truth(q, [0.4, 0.0, 0.0], 0.7)
    assert (world.truth.eta[:, 0] > 0.002).tolist() == [True, False]


def test_a_robot_across_a_slope_measures_sideways_gravity():
    q = robots(slope_rad=np.full(1, 0.1), slope_heading_rad=np.full(1, np.pi / 2))
    _, z = drive_truth(q, [0.0, 0.0, 0.0], 0.3)
    assert z[0, 1] == pytest.approx(9.80665 * np.sin(0.1), rel=0.02)


def test_a_car_rolls_downhill_at_the_speed_of_force_balance():
    straight = {"servo_offset_rad": np.zeros(1)}
    q = cars(slope_rad=np.full(1, 0.1), slope_heading_rad=np.full(1, np.pi), **straight)  # downhill ahead
    world, z = drive_truth(q, [0.0, 0.0], 5.0)
    v, pull = world.truth.nu[0, 0], 9.80665 * np.sin(0.1) * q.mass_kg[0]
    drag = q.dry_n[0] * np.tanh(v / 0.05) + (q.rolling[0] + q.air_drag[0] * v) * v
    assert drag == pytest.approx(pull, rel=1e-3)
    assert z[0, 0] == pytest.approx(-drag / q.mass_kg[0], rel=1e-3)


def with_transmission(vehicles, **values):
    n = len(vehicles.mass_kg)
    return vehicles.with_parameters(transmission=Transmission.ideal(n).with_parameters(**values))


def test_a_slipping_wheel_has_limited_force_and_turns_faster():
    q = with_transmission(robots(2), grip_n=np.array([0.3, np.inf]))
    world = TruthWorld(q, range(2))
    velocities = [world.tick(np.tile([0.9, 0.0, 0.0], (2, 1)), 0.01)[:, 0] for _ in range(60)]
    largest = np.max(velocities, axis=0)
    assert largest[0] <= 2.0 * 0.3 / 0.61 + 1e-9 < largest[1]
    assert world.rolling_speed[0] > world.truth.nu[0, 0] + 0.1
    assert world.rolling_speed[1] == world.truth.nu[1, 0]


def test_a_slipping_wheel_grips_again_at_low_command():
    q = with_transmission(robots(), grip_n=np.array([0.5]))
    world, _ = drive_truth(q, [0.9, 0.0, 0.0], 0.3)
    spun = world.rolling_speed[0] - world.truth.nu[0, 0]
    for _ in range(100):
        world.tick(np.array([[0.4, 0.0, 0.0]]), 0.01)
    assert world.rolling_speed[0] - world.truth.nu[0, 0] < 0.2 * spun


def test_the_motor_crosses_the_backlash_at_no_load_speed():
    """With T = f and f = F (1 − e^(−t/λ)) effective at once, half of the play is ∫ f dt/e."""
    play, F, zero = 0.02, 1.69 * 0.4, np.zeros(1)
    q = with_transmission(robots(), play_m=np.full(1, play)).with_parameters(
        gain=np.ones((1, 2)), stall_n=np.full(1, 1.69), forward=np.full((1, 2), 0.6 - 0.4), lag_s=np.full(1, 0.02),
        delay_s=zero, dry=np.zeros((1, 3)),
    )  # fmt: skip
    e = 0.5 * q.viscous[0, 0]
    time_s = brentq(lambda t: F / e * (t - 0.02 * (1.0 - np.exp(-t / 0.02))) - 0.5 * play, 1e-3, 1.0)
    world = TruthWorld(q, [0])
    while world.truth.nu[0, 0] == 0.0:
        world.tick(np.array([[0.6, 0.0, 0.0]]), 0.001)
    assert world.t_s == pytest.approx(time_s, abs=0.0021)


def test_within_the_backlash_a_robot_rolls_without_motor_force():
    q = with_transmission(robots(), play_m=np.full(1, 1.0)).with_parameters(
        dry=np.zeros((1, 3)), quadratic=np.zeros((1, 3))
    )
    world = TruthWorld(q, [0])
    world._x[0, 3] = 0.4
    world.tick(np.array([[0.0, 0.0, 0.0]]), 0.2)
    # the back-EMF of the motor does not reach it
    assert world.truth.nu[0, 0] == pytest.approx(0.4, rel=1e-12)


def test_a_second_order_motor_has_the_analytic_step_response():
    a, b = 0.05, 0.08
    q = with_transmission(robots(), second_lag_s=np.full(1, b)).with_parameters(
        lag_s=np.full(1, a), delay_s=np.zeros(1)
    )
    world, _ = drive_truth(q, [0.8, 0.0, 0.0], 0.1)
    duty = round(255 * 0.8) / 255
    steady = q.gain[0] * q.stall_n[0] * (duty - q.forward[0])
    part = 1.0 - (a * np.exp(-0.1 / a) - b * np.exp(-0.1 / b)) / (a - b)
    np.testing.assert_allclose(world._x[0, 6:8], steady * part, rtol=1e-6)


def smooth_robots():
    return with_transmission(robots(), second_lag_s=np.full(1, 0.05), grip_n=np.full(1, 0.6))


@pytest.mark.parametrize(
    ("make", "signals"),
    [
        (smooth_robots, [[0.7, 0.0, -0.1], [-0.6, 0.0, 0.4], [0.0, 0.0, 0.9]]),
        (robots, [[0.7, 0.0, -0.1], [-0.6, 0.0, 0.4], [0.0, 0.0, 0.9]]),
        (cars, [[0.3, 0.6], [0.5, -0.5], [-0.2, 0.3]]),
    ],
)
def test_the_integration_step_is_fine_enough_for_any_delay(make, signals):
    """Against an adaptive integrator restarted at each effective command, with ticks of 10 and of 7.3 ms."""
    vehicles = make()
    world, x, sends = TruthWorld(vehicles, [0]), np.zeros(vehicles.states), []
    for dt_s, u in zip([0.0073, 0.01] * 15, np.repeat(signals, 10, axis=0), strict=True):
        sends.append((world.t_s + float(vehicles.delay_s[0]), u))
        world.tick(u[None], dt_s)
    edges = [0.0, *(t for t, _ in sends if t < world.t_s), world.t_s]
    for start, end, u in zip(edges, edges[1:], [0.0 * sends[0][1], *(u for _, u in sends)], strict=False):
        rate = lambda t, x, u=u: vehicles.state_derivative(u[None])(x[None])[0]  # noqa: E731
        x = solve_ivp(rate, (start, end), x, rtol=1e-9, atol=1e-11).y[:, -1]
    np.testing.assert_allclose(world._x[0], x, atol=2e-7)


def test_other_vehicles_do_not_change_a_simulation():
    two = draw_robots(2, 5)
    pair, single = TruthWorld(two, [7, 8]), TruthWorld(two.subset([1]), [8])
    for k in range(20):
        u = np.array([[0.5, 0.0, 0.2], [0.8, 0.0, -0.4]]) * (k % 3)
        np.testing.assert_array_equal(pair.tick(u, 0.01)[1:], single.tick(u[1:], 0.01))


def test_an_understeering_car_needs_more_steering_on_a_circle():
    """δ = L ω/v + U v ω at small angles, and U = 0 with equal tyres."""
    lateral = {"grip_n": np.full((2, 2), 1e4), "tyre_n_rad": np.array([[15.0, 22.0], [20.0, 20.0]])}
    q = cars(2, **lateral, servo_offset_rad=np.zeros(2), servo_rad=np.full(2, 0.5))
    world, z = drive_truth(q, [0.35, 0.04], 1.7)
    v, _, w = world.truth.nu.T
    assert q.understeer[1] == pytest.approx(0.0)
    np.testing.assert_allclose(0.15 * w / v + q.understeer * v * w, 0.02, rtol=5e-3)
    assert np.all(v > 0.8)
    np.testing.assert_allclose(z[:, 1], v * w, rtol=0.01)


def test_a_car_reaches_the_speed_of_force_balance():
    q = cars(servo_offset_rad=np.zeros(1))
    world, _ = drive_truth(q, [0.4, 0.0], 2.0)
    v = world.truth.nu[0, 0]
    force = q.stall_n[0] * (0.4 - q.zone[0, 0])
    assert force == pytest.approx(q.dry_n[0] + (q.rolling[0] + q.air_drag[0] * v) * v, rel=0.03)


def test_the_tyre_force_is_limited_by_its_grip():
    world, z = drive_truth(cars(), [0.9, 0.9], 0.8)
    assert np.abs(z[0, 1]) < 1.02 * np.sum(world.physics.grip_n) / world.physics.mass_kg[0]
