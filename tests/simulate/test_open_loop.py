"""A signal through the kernel gives the vehicle motion of the simulated world and of plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify
from baqueano.signals import Command
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from baqueano.worlds import SimulatedWorld
from tests.codes import refused

RNG = np.random.default_rng(3)
U = np.repeat(RNG.uniform(-1, 1, (12, 3)) * [1.0, 0.0, 1.0], 25, axis=0)


def test_kernel_and_simulated_world_give_the_same_motion(vehicle):
    run = simulate(vehicle, U, seed=5, eta0=np.array([1.0, 2.0, 3.0]))
    world = SimulatedWorld(vehicle.vehicle, vehicle.sensors, 100.0, seed=5, eta0=np.array([1.0, 2.0, 3.0]))
    ticks = []
    for k, t_ns in enumerate(run.t_ns):
        world.write(Command(0, U[k]))
        ticks += world.read(int(t_ns))
    assert [tick.t_ns for tick in ticks] == run.t_ns.tolist()
    np.testing.assert_allclose([tick.sensors.imu.z for tick in ticks], run.sensors["imu"].z, atol=1e-11)
    np.testing.assert_allclose(world.truth.eta, run.truth.eta[-1], atol=1e-11)


def test_a_tick_too_long_for_the_integrator_is_subdivided():
    """The wheels of the small vehicle stop sideways motion with a time constant of 15 ms: one step of 50 ms
    diverges."""
    file, u = load("small"), np.repeat(U[::25], 5, axis=0)
    slow = file.with_values({"sensors.imu.rate_hz": 20.0})
    run = simulate(slow, u, rate_hz=20.0, noise=False)
    fine = simulate(file, np.repeat(u, 5, axis=0), noise=False)
    assert run.t_ns.tolist() == fine.t_ns[4::5].tolist()
    np.testing.assert_allclose(run.truth.nu, fine.truth.nu[4::5], atol=0.02)
    assert run.sensors["imu"].t_ns.tolist() == run.t_ns.tolist()
    np.testing.assert_allclose(run.sensors["imu"].z[:, 2], fine.sensors["imu"].z[4::5, 2], atol=0.02)
    assert run.metadata["rate_hz"] == "20"
    fit = identify(run, slow, ["model.friction.linear[0]"], options=FitOptions(diagnose=False))
    assert fit.value("model.friction.linear[0]") == pytest.approx(file.vehicle.friction.linear[0], rel=1e-3)


def test_a_sensor_answers_at_its_rate_but_at_most_once_per_tick():
    file, u = load("small"), np.repeat(U[::25], 5, axis=0)
    often = simulate(file, u, rate_hz=20.0)
    assert often.sensors["imu"].arrival_ns.tolist() == often.t_ns.tolist()
    rare = simulate(file.with_values({"sensors.imu.rate_hz": 7.0}), u, rate_hz=20.0)
    imu = rare.sensors["imu"]
    assert len(imu.t_ns) == int(7.0 * rare.t_ns[-1] * 1e-9 + 1e-6)
    assert np.all(np.isin(imu.arrival_ns, rare.t_ns))
    assert np.all((imu.arrival_ns - imu.t_ns >= 0) & (imu.arrival_ns - imu.t_ns < 50_000_000))


def test_all_back_ends_give_the_same_simulation(vehicle):
    a, b = (simulate(vehicle, U[:60], seed=5, backend=name) for name in ("auto", "numpy"))
    np.testing.assert_allclose(a.truth.eta, b.truth.eta, atol=1e-12)
    np.testing.assert_allclose(a.sensors["imu"].z, b.sensors["imu"].z, atol=1e-12)


def test_the_same_seed_gives_exactly_the_same_run(vehicle):
    assert simulate(vehicle, U, seed=1) == simulate(vehicle, U, seed=1)
    assert simulate(vehicle, U, seed=1) != simulate(vehicle, U, seed=2)


def test_an_additional_sensor_does_not_change_the_noise_of_others(vehicle, vehicle_with_odometer):
    a, b = simulate(vehicle, U, seed=1), simulate(vehicle_with_odometer, U, seed=1)
    np.testing.assert_allclose(a.sensors["imu"].z, b.sensors["imu"].z, rtol=0, atol=1e-13)
    np.testing.assert_allclose(a.truth.eta, b.truth.eta, rtol=0, atol=1e-13)


def test_each_sensor_measures_at_its_rate(vehicle_with_odometer):
    run = simulate(vehicle_with_odometer, U, seed=1)
    assert len(run.sensors["imu"].t_ns) == 300
    assert len(run.sensors["odometer"].t_ns) == 60
    assert set(np.diff(run.sensors["odometer"].t_ns)) == {50_000_000}


def test_noise_has_the_standard_deviation_of_the_file(vehicle):
    """Bounds of 4.5 σ of a sample deviation over 3000 draws: a false alarm in 150 000."""
    zero = np.zeros((3000, 3))
    imu = replace(vehicle.sensors.imu, gyro_bias=0.0, gyro_bias_walk=0.0)
    vehicle.sensors = vehicle.sensors._replace(imu=imu)
    vehicle.vehicle = replace(vehicle.vehicle, process_noise_std=np.zeros(3))
    z = simulate(vehicle, zero, seed=11).sensors["imu"].z
    std = np.sqrt(np.mean(z**2, axis=0))
    np.testing.assert_allclose(std, [0.05, 0.05, 0.002], rtol=4.5 / np.sqrt(2 * 3000))


def test_a_simulation_without_noise_is_deterministic(vehicle):
    a, b = simulate(vehicle, U, seed=1, noise=False), simulate(vehicle, U, seed=2, noise=False)
    assert np.array_equal(a.sensors["imu"].z, b.sensors["imu"].z)
    np.testing.assert_allclose(a.sensors["imu"].z[:, 2], a.truth.nu[:, 2] + 0.01, atol=1e-12)


def test_the_run_contains_truth_signal_and_metadata(vehicle):
    run = simulate(vehicle, U, seed=7)
    assert run.applied_commands.tolist() == U.tolist()
    assert run.t_ns[0] == 10_000_000
    assert run.truth.eta.shape == (300, 3)
    assert run.vehicle_text == vehicle.text
    assert run.metadata["seed"] == "7"
    assert run.metadata["backend"] in ("c", "python", "numpy")
    assert {"numpy", "python", "baqueano"} <= run.metadata.keys()


def test_the_simulation_starts_at_the_given_state(vehicle):
    run = simulate(vehicle, np.zeros((2, 3)), eta0=[1, 2, 3], nu0=[0.5, 0, 0], noise=False)
    np.testing.assert_allclose(
        run.truth.eta[0, :2], [1 + 0.005 * np.cos(3), 2 + 0.005 * np.sin(3)], atol=2e-4
    )


@pytest.mark.parametrize(
    ("u", "words"),
    [
        (
            np.zeros((5, 2)),
            ("simulate.signal-shape", {"value": "(5, 2)", "commands": 3, "names": "u_x, u_y, u_psi"}),
        ),
        (np.zeros((0, 3)), ("simulate.signal-shape", {"value": "(0, 3)", "commands": 3})),
        (np.array([[0.0, 0.0, np.nan]]), ("simulate.not-finite", {"name": "u_psi", "tick": 0})),
        (
            np.array([[0.0] * 3, [1.5, 0, 0]]),
            ("simulate.beyond-limit", {"name": "u_x", "value": 1.5, "tick": 1, "limit": 1.0}),
        ),
    ],
)
def test_an_unsuitable_signal_is_refused_with_a_reason(vehicle, u, words):
    with refused(words[0], UsageError, **words[1]):
        simulate(vehicle, u)


def test_a_start_that_is_not_a_pose_is_refused(vehicle):
    with refused("simulate.pose", UsageError, name="eta0", value="[1.0, 2.0]"):
        simulate(vehicle, U, eta0=[1, 2])
