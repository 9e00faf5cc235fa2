"""A tick that is too long for the integrator is divided into rows, by the world, the filter and the controller."""

import numpy as np
import pytest

from baqueano import loop
from baqueano.guides.shapes import circle
from baqueano.signals import Command
from baqueano.simulate import simulate, simulate_loop
from baqueano.simulate.closed_loop import loop_system
from baqueano.vehicle_file import load
from baqueano.worlds import FaultyWorld, SimulatedWorld, clock

SLOW = load("small").with_values({"rate_hz": 10.0, "model.drivetrain.delay_s": 0.13})
SEED, TICKS = 3, 40


def drive_loop(world):
    """Return command, truth and reading of each tick, under commands that depend on the speed."""
    u, eta, z = [], [], []
    for k in range(1, TICKS + 1):
        (tick,) = world.read(k * 100_000_000)
        u.append(tick.u)
        eta.append(world.truth.eta)
        z.append(tick.sensors.imu.z)
        command = np.clip(4.0 * (0.2 - world.truth.nu[0]), -1.0, 1.0)
        world.write(Command(tick.t_ns, np.array([command, 0.0, 0.3 * (-1.0) ** (k // 5)])))
    return np.array(u), np.array(eta), np.array(z)


@pytest.mark.parametrize("kind", [SimulatedWorld, FaultyWorld])
def test_a_closed_loop_at_10_hz_equals_its_open_loop_replay(kind):
    u, eta, z = drive_loop(kind(SLOW.vehicle, SLOW.sensors, SLOW.rate_hz, SEED))
    run = simulate(SLOW, u, SEED)
    np.testing.assert_allclose(eta, run.truth.eta, atol=1e-9)
    np.testing.assert_allclose(z, run.sensors["imu"].z, atol=1e-9)


def test_a_closed_loop_at_10_hz_equals_a_solution_with_fine_steps():
    noiseless = SLOW.with_values(
        {
            "model.process_noise_std": [0.0] * 3,
            "sensors.imu.accel_noise_std": [0.0] * 2,
            "sensors.imu.gyro_noise_std": 0.0,
        }
    )
    u, eta, _ = drive_loop(SimulatedWorld(noiseless.vehicle, noiseless.sensors, noiseless.rate_hz, SEED))
    fine = noiseless.with_values({"rate_hz": 1000.0})
    exact = simulate(fine, np.repeat(u, 100, axis=0), noise=False).truth.eta[99::100]
    assert np.ptp(exact[:, 0]) > 0.3
    np.testing.assert_allclose(eta, exact, atol=2e-3)


def test_compiled_and_clocked_loop_agree_at_10_hz():
    route = circle(0.5, 0.2)
    run = simulate_loop(SLOW, route, seed=4, duration_s=3.0)
    world, records = SimulatedWorld(SLOW.vehicle, SLOW.sensors, SLOW.rate_hz, seed=4), []
    loop.run(
        loop_system(SLOW, route).blocks,
        world,
        clock.simulated_ticks(SLOW.rate_hz, 3.0),
        on_record=records.append,
        eta=np.zeros(3),
    )
    for k, record in enumerate(records[: len(run.t_ns)]):
        np.testing.assert_allclose(record.tick.u, run.applied_commands[k], atol=1e-9)
        np.testing.assert_allclose(record.estimate.eta, run.estimate.eta[k], atol=1e-9)
    assert np.abs(run.truth.nu[-10:, 0] - 0.2).max() < 0.03
    assert np.abs(run.estimate.nu - run.truth.nu)[:, 0].max() < 0.02
