"""A simulated world is a sequence of pure steps; a replayed world repeats its ticks."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive import experiment, replay
from baqueano.drive.session import drive_stop_reason
from baqueano.errors import UsageError
from baqueano.runs import Channel, Run, TruthLog
from baqueano.sensors import Imu
from baqueano.signals import Command, Slot, sensor_slots
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from baqueano.vehicles import Friction, Planar
from baqueano.worlds import ReplayedWorld, SimulatedWorld, world_init, world_step
from baqueano.worlds.noise import PROCESS_STREAM, sensor_stream, unit_normals
from baqueano.worlds.simulated import DrawnNoise, no_noise
from tests.codes import refused

VEHICLE = Planar(
    mass_kg=0.61,
    inertia_kg_m2=0.0015,
    actuator_matrix=np.diag([1.5, 0.0, 0.03]),
    friction=Friction(linear=np.array([1.2, 4.0, 0.006])),
    process_noise_std=np.array([0.02, 0.005, 0.05]),
)
IMU = Imu(accel_noise_std=np.array([0.05, 0.05]), gyro_noise_std=0.005)
SENSORS = sensor_slots(("imu",))(IMU)
U = np.array([0.6, 0.0, 0.2])


def make_ticks(sensors, n=600, seed=3, bundle=1, backend="numpy"):
    world, ticks = SimulatedWorld(VEHICLE, sensors, rate_hz=100.0, seed=seed, backend=backend), []
    world.write(Command(0, U))
    for k in range(bundle, n + 1, bundle):
        ticks += world.read(k * 10_000_000)
    return ticks, world


def test_the_world_equals_the_pure_step_with_the_same_noise():
    ticks, world = make_ticks(SENSORS)
    process, imu = unit_normals(3, PROCESS_STREAM, 600, 3), unit_normals(3, sensor_stream("imu"), 600, 6)
    state = world_init(VEHICLE, SENSORS)
    for k, tick in enumerate(ticks):
        state, truth, slots = world_step(VEHICLE, SENSORS, state, U, 0.01, DrawnNoise(process[k], (imu[k],)))
        assert tick.t_ns == (k + 1) * 10_000_000
        assert np.array_equal(tick.u, U)
        assert np.array_equal(tick.sensors.imu.z, slots.imu.z)
    assert np.array_equal(world.truth.eta, truth.eta)


def test_reading_seven_ticks_at_a_time_gives_the_same_ticks():
    first, _ = make_ticks(SENSORS)
    seven, _ = make_ticks(SENSORS, n=602, bundle=7)
    assert all(
        a.t_ns == b.t_ns and np.array_equal(a.sensors.imu.z, b.sensors.imu.z)
        for a, b in zip(first, seven, strict=False)
    )


def test_a_command_acts_from_the_next_tick():
    world = SimulatedWorld(VEHICLE, SENSORS, backend="numpy")
    (first,) = world.read(10_000_000)
    world.write(Command(10_000_000, U))
    (second,) = world.read(20_000_000)
    assert np.array_equal(first.u, np.zeros(3))
    assert np.array_equal(second.u, U)
    assert world.read(20_000_000) == []


def test_without_noise_a_resting_vehicle_stays_and_its_imu_measures_zero():
    state = world_init(VEHICLE, SENSORS)
    state, truth, slots = world_step(VEHICLE, SENSORS, state, np.zeros(3), 0.01, no_noise(SENSORS))
    assert np.array_equal(truth.eta, np.zeros(3))
    assert np.array_equal(slots.imu.z, np.zeros(3))


def load_run(ticks, truth=None):
    t_ns = np.array([t.t_ns for t in ticks])
    z = np.array([t.sensors.imu.z for t in ticks])
    u = np.array([t.u for t in ticks]).reshape(len(ticks), 3)
    channel = Channel(t_ns, t_ns, z.reshape(len(ticks), 3))
    return Run("test", None, t_ns, u, sensors={"imu": channel}, truth=truth)


def test_a_replayed_world_repeats_its_ticks_for_any_command():
    ticks, simulated_run = make_ticks(SENSORS, n=50)
    motions = simulated_run.new_truths()
    assert [t for t, _ in motions] == [t.t_ns for t in ticks]
    assert simulated_run.new_truths() == []
    truth = TruthLog(
        np.array([t for t, _ in motions]), *(np.array([m[i] for _, m in motions]) for i in (0, 1, 2))
    )
    world, ticks_read, truths = ReplayedWorld(load_run(ticks, truth)), [], []
    assert world.new_truths() == []
    for t_ns in world.times:
        ticks_read += world.read(t_ns)
        truths += world.new_truths()
        world.write(Command(t_ns, -5.0 * U))
    assert [t.t_ns for t in ticks_read] == [t.t_ns for t in ticks]
    assert all(
        np.array_equal(a.sensors.imu.z, b.sensors.imu.z) for a, b in zip(ticks_read, ticks, strict=True)
    )
    assert [t for t, _ in truths] == [t for t, _ in motions]
    assert all(np.array_equal(a.eta, b.eta) for (_, a), (_, b) in zip(truths, motions, strict=True))
    assert world.commands == 3


def test_an_empty_run_is_refused_with_a_reason():
    with refused("replay.empty", ValueError, run="test"):
        ReplayedWorld(load_run([]))


def test_a_recording_without_gaps_is_replayed_unchanged():
    ticks, _ = make_ticks(SENSORS, n=50)
    jittered_ticks = [t._replace(t_ns=t.t_ns + 3_000_000 * (k % 2)) for k, t in enumerate(ticks)]
    world = ReplayedWorld(load_run(jittered_ticks))
    assert world.times == [t.t_ns for t in jittered_ticks]
    assert world.notes == ()


def test_a_gap_is_filled_with_ticks_without_readings():
    ticks, _ = make_ticks(SENSORS, n=200)
    world = ReplayedWorld(load_run(ticks[:50] + ticks[150:]))
    assert world.times == [t.t_ns for t in ticks]
    assert [(note.code, note.figures["count"]) for note in world.notes] == [("replay.holes", 100)]
    hole = world.read(world.times[-1])[50:150]
    assert all(t.sensors.imu.is_new == 0.0 and np.array_equal(t.u, U) for t in hole)


def test_a_gap_of_a_day_is_filled_only_partly():
    ticks, _ = make_ticks(SENSORS, n=20)
    later_ticks = [t._replace(t_ns=t.t_ns + 86_400 * 1_000_000_000) for t in ticks[10:]]
    assert len(ReplayedWorld(load_run(ticks[:10] + later_ticks)).times) < 6100


def test_no_limit_of_the_file_ends_the_replay_of_an_imported_recording():
    """A recording of others was made without our supervisor; a drive of ours repeats its stop."""
    small = load("small")
    limited_file = small.with_values({"supervisor.max_speed_m_s": 0.05})
    recorded_run = simulate(small, np.tile([0.8, 0.0, 0.0], (60, 1)))
    imported_run = replace(recorded_run, metadata={**recorded_run.metadata, "kind": "import"})
    stop = drive_stop_reason(replay(recorded_run, limited_file))
    assert stop is not None
    assert stop.code == StopReason.SPEED
    full_replay = replay(imported_run, limited_file)
    assert drive_stop_reason(full_replay) is None
    assert full_replay.t_ns[-1] == recorded_run.t_ns[-1]


WRONG_TICKS = {
    "world.ticks": lambda tick: tick,
    "world.times": lambda tick: [tick._replace(t_ns=1e-9 * tick.t_ns)],
    "world.command": lambda tick: [tick._replace(u=np.zeros(2))],
    "world.sensors": lambda tick: [tick._replace(sensors=sensor_slots(("gyro",))(tick.sensors.imu))],
    "world.reading": lambda tick: [tick._replace(sensors=tick.sensors._replace(imu=Slot(1.0, 0.3)))],
}


@pytest.mark.parametrize("code", WRONG_TICKS)
def test_an_error_in_the_ticks_of_a_user_world_names_the_world(code):
    class Mine(SimulatedWorld):
        def read(self, t_ns):
            return WRONG_TICKS[code](super().read(t_ns)[-1])

    file = load("small")
    with refused(code, UsageError, world="Mine"):
        experiment(file, np.zeros((10, 3)), world=Mine(file.vehicle, file.sensors, file.rate_hz))
