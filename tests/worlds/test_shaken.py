"""A world with faults: pure inputs; the same faults and seed give the same numbers; without the fault the run is
equal before it.
"""

import numpy as np
import pytest

from baqueano.drive import experiment, repeat
from baqueano.drive.recording import SHAKE_SOURCE
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from baqueano.runs import read_run
from baqueano.signals import STANDARD_GRAVITY, Command
from baqueano.vehicle_file import load
from baqueano.vehicle_file.file import parse
from baqueano.worlds import Fault, FaultyWorld, SimulatedWorld, fault_ledger
from baqueano.worlds.faults.fault import PUSH_S
from tests.codes import refused
from tests.faults_of_run import find_faults

FILE = load("small")
ALL = [
    "0.5 s: push 0.2 N s left", "0.8-1.2 s: tilt 2 deg towards 90 deg", "1.3-1.5 s: cut imu",
    "0.2 s: drift imu[2] 0.05", "0.1-2 s: spikes imu[0] 5, 10 %", "0.6-1 s: slip left 30 %", "1.6 s: sag 84 %",
    "0.4-1.9 s: lose 30 %",
]  # fmt: skip


def world(cls=FaultyWorld, file=FILE, **options):
    return cls(file.vehicle, file.sensors, file.rate_hz, backend="numpy", **options)


def drive_world(simulated_world, seconds=2.0, u=(0.5, 0.0, 0.1), faults_at=None, rate_hz=FILE.rate_hz):
    """Return truth and readings (N, 9) of each tick; `faults_at` is called before the tick of this number."""
    rows = []
    for k in range(round(seconds * rate_hz)):
        if faults_at is not None and k in faults_at:
            faults_at[k](simulated_world)
        simulated_world.write(Command(0, np.array(u)))
        (tick,) = simulated_world.read(round((k + 1) * 1e9 / rate_hz))
        rows.append(np.concatenate([simulated_world.truth.eta, simulated_world.truth.nu, tick.sensors.imu.z]))
    return np.array(rows)


def test_without_faults_the_world_equals_the_simulated_world():
    np.testing.assert_array_equal(drive_world(world()), drive_world(world(SimulatedWorld)))


@pytest.mark.parametrize("words", ALL)
def test_a_fault_acts_from_its_first_tick(words):
    fault = Fault.parse(words)
    rows, twin = drive_world(world(shake=[fault])), drive_world(world())
    first = round(fault.start_s * FILE.rate_hz)
    np.testing.assert_array_equal(rows[:first], twin[:first])
    if fault.kind != "lose":  # the command does not change here, but readings do
        assert np.any(rows[first:] != twin[first:])
    else:
        assert np.mean(rows[first:190, 8] == 0.0) == pytest.approx(0.3, abs=0.1)


def test_removing_a_fault_does_not_change_the_noise_of_others():
    spikes = Fault.parse("0.1-2 s: spikes imu[0] 5, 10 %")
    lone = drive_world(world(shake=[spikes]))
    two_faults = drive_world(world(shake=[spikes, "1 s: spikes imu[1] 5, 20 %", "1.5 s: drift imu[2] 0.1"]))
    np.testing.assert_array_equal(lone[:, 6], two_faults[:, 6])


def test_a_push_changes_the_velocity_by_impulse_over_mass():
    standing = {"u": (0.0, 0.0, 0.0), "seconds": 0.5 + PUSH_S}
    heavy = FILE.with_values({"model.friction.linear": [0.0] * 3, "model.friction.coulomb": [0.0] * 3,
                              "model.friction.quadratic": [0.0] * 3, "model.process_noise_std": [0.0] * 3})  # fmt: skip
    for words in ("0.5 s: push 0.3 N s left", {"kind": "push", "start_s": 0.5, "x": -0.3, "frame": "map"}):
        pushed_world = world(file=heavy, shake=[words], eta0=np.array([0.0, 0.0, np.pi / 2.0]))
        nu = drive_world(pushed_world, **standing)[-1, 3:6]
        np.testing.assert_allclose(nu, [0.0, 0.3 / 0.61, 0.0], atol=1e-9)
        event = pushed_world.new_events()[0][1]
        assert event.figures["direction"].code == "shake.way-left"


def test_an_imu_measures_pushes_and_floor_forces_but_not_free_fall():
    noiseless = {"sensors.imu.accel_noise_std": [0.0, 0.0], "sensors.imu.accel_bias": [0.0, 0.0],
             "sensors.imu.tilt_rad": [0.0, 0.0], "sensors.imu.accel_bias_walk": 0.0}  # fmt: skip
    rough = FILE.with_values(noiseless | {"model.friction.linear": [15.0, 15.0, 0.05]})
    ahead = drive_world(world(file=rough, shake=[Fault("tilt", x=0.05)]), u=(0.0, 0.0, 0.0))[-1, 6]
    assert ahead == pytest.approx(STANDARD_GRAVITY * np.sin(0.05), rel=0.02)  # nose up: it is pushed ahead
    free = FILE.with_values(
        noiseless | {f"model.friction.{k}": [0.0] * 3 for k in ("linear", "quadratic", "coulomb")}
    )
    falling = drive_world(world(file=free, shake=[Fault("tilt", x=0.05)]), u=(0.0, 0.0, 0.0))
    assert falling[-1, 6] == pytest.approx(0.0, abs=1e-3)
    assert falling[-1, 3] == pytest.approx(-2.0 * STANDARD_GRAVITY * np.sin(0.05), rel=0.01)


def test_slipping_wheels_measure_a_higher_speed_and_drive_with_less_force():
    file = parse(
        FILE.text + '\n[sensors.wheels]\nkind = "wheels"\nrate_hz = 100.0\nnoise_std = 0.0\n', "wheels"
    )
    simulated_world = world(file=file, shake=["1-2 s: slip left 30 %"])
    ratios = []
    for k in range(150):
        simulated_world.write(Command(0, np.array([0.7, 0.0, 0.0])))
        (tick,) = simulated_world.read((k + 1) * 10_000_000)
        nu = simulated_world.truth.nu
        wheel_speeds = nu[0] + np.array([-0.06, 0.06]) * nu[2]
        ratios.append(tick.sensors.wheels.z / np.where(wheel_speeds == 0.0, 1.0, wheel_speeds))
    np.testing.assert_allclose(ratios[90], [1.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(ratios[140], [1.5, 1.0], rtol=1e-9)


def test_a_faulty_run_stores_its_faults_and_is_exactly_reproducible(tmp_path):
    path = tmp_path / "run.mcap"
    run = repeat(FILE, circle(0.3, 0.2), shake=ALL, seed=4, duration_s=3.0, path=path)
    faults_of_run = find_faults((e.t_ns, e.source, e.diagnostic) for e in read_run(path).events)
    assert sorted(faults_of_run, key=str) == sorted(map(Fault.parse, ALL), key=str)
    second = repeat(FILE, circle(0.3, 0.2), shake=faults_of_run, seed=4, duration_s=3.0)
    for series in (
        lambda run: run.truth.eta, lambda run: run.estimate.eta, lambda run: run.applied_commands,
        lambda run: run.sensors["imu"].z,
    ):  # fmt: skip
        np.testing.assert_array_equal(series(run), series(second))


def test_faults_added_during_a_run_are_exactly_reproducible():
    lively = world(units={"imu[2]": "rad/s"})
    faults_at = {
        50: lambda w: w.begin_fault({"kind": "drift", "target": "imu[2]", "size": 0.1}),
        80: lambda w: w.begin_fault({"kind": "tilt", "x": 0.03}),
        120: lambda w: w.end_fault(1),
        130: lambda w: w.begin_fault({"kind": "tilt", "y": 0.02}),  # replaces the first
        150: lambda w: w.begin_fault({"kind": "push", "x": 0.1, "frame": "map"}),
    }
    rows = drive_world(lively, faults_at=faults_at)
    events = [(t_ns, SHAKE_SOURCE, event) for t_ns, event in lively.new_events()]
    faults_of_run = find_faults(events)
    assert [fault.kind for fault in faults_of_run] == ["drift", "tilt", "tilt", "push"]
    over = next(event for _, _, event in events if event.code == "shake.end")
    assert over.figures["fault"].figures["unit"] == "rad/s"
    assert (faults_of_run[0].start_s, faults_of_run[0].duration_s) == (0.5, pytest.approx(0.7))
    assert faults_of_run[1].duration_s == pytest.approx(0.5)
    np.testing.assert_array_equal(drive_world(world(shake=faults_of_run)), rows)


def test_the_message_of_a_fault_of_a_channel_contains_its_unit():
    faults = ["0 s: drift imu[2] 0.1", "0.1 s: spikes imu[0] 5, 20 %"]
    run = experiment(FILE, np.zeros((20, 3)), shake=faults, backend="numpy")
    units = [e.diagnostic.figures["unit"] for e in run.events if e.source == SHAKE_SOURCE]
    assert units == ["rad/s", "m/s²"]


def test_a_fault_free_simulation_is_identical_until_the_fault():
    u = np.tile([0.5, 0.0, 0.1], (300, 1))
    shaken_run, twin = (experiment(FILE, u, seed=2, shake=s) for s in (["1 s: sag 84 %"], []))
    np.testing.assert_array_equal(shaken_run.truth.eta[:100], twin.truth.eta[:100])
    assert np.hypot(*(shaken_run.truth.eta - twin.truth.eta)[-1, :2]) > 0.05


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("push 0.3 N s left", "shake.syntax"),
        ("3 s: dance", "shake.syntax"),
        ("3 s: push 0.3 N s up", "shake.parts"),
        ("3 s: cut gps", "shake.target"),
        ("3 s: drift imu[7] 1", "shake.target"),
        ("5-3 s: cut imu", "shake.number"),
        ("3 s: sag 200 %", "shake.number"),
        ("3 s: slip front 30 %", "shake.parts"),
        ({"kind": "push", "x": float("nan")}, "shake.number"),
        ({"kind": "push", "y": 1e6}, "shake.number"),
        ({"kind": "push", "frame": "moon"}, "shake.target"),
        ({"kind": "slip", "target": "front", "part": 0.3}, "shake.target"),
        ({"kind": "tilt", "angle": 3}, "shake.fields"),
        ({"kind": "tilt", "x": "steep"}, "shake.number"),
        ({"x": 1.0}, "shake.fields"),
        (7, "shake.fields"),
        ({"kind": "earthquake"}, "shake.kind"),
    ],
)
def test_an_invalid_fault_is_refused(words, code):
    with refused(code, UsageError):
        world(shake=[words])


def test_an_unsuitable_fault_for_a_vehicle_is_refused():
    car = load("car")
    with refused("shake.no-mass", UsageError):
        world(file=car, shake=["1 s: push 0.3 N s left"])
    with refused("shake.target", UsageError):
        world(file=car, shake=["1 s: slip left 30 %"])
    with refused("shake.of-another-world", UsageError):
        experiment(FILE, np.zeros((10, 3)), world=world(), shake=[])
    with refused("shake.no-number", UsageError):
        world().end_fault(1)


def rows_of(words, seconds=8.0):
    run = repeat(FILE, circle(0.4, 0.25), laps=0, seed=1, duration_s=seconds, shake=[words])
    ledger = fault_ledger(run, FILE)
    (row,) = ledger.rows
    return ledger, row


def test_the_ledger_lists_each_detection_with_its_time():
    _, row = rows_of("4 s: push 0.4 N s left")
    nis = next(notice for notice in row.notices if notice.witness == "nis")
    assert 0.0 < nis.after_s < 0.1
    assert nis.message.figures["nis"] > nis.message.figures["maximum"]
    _, row = rows_of("4-6 s: cut imu")
    stop = next(notice for notice in row.notices if notice.witness == "supervisor")
    assert stop.after_s == pytest.approx(0.5, abs=0.05)  # imu_timeout_s
    _, row = rows_of("4 s: drift imu[2] 1")
    assert "monitor" in [notice.witness for notice in row.notices]


def test_the_detection_of_a_fault_is_not_assigned_to_the_next_fault():
    u = np.tile([0.5, 0.0, 0.1], (600, 1))
    run = experiment(FILE, u, seed=1, shake=["3 s: push 0.4 N s left", "3.5 s: drift imu[2] 0.02"])
    push, drift = fault_ledger(run, FILE).rows
    assert "nis" in [notice.witness for notice in push.notices]
    assert drift.notices == []


def test_the_ledger_gives_the_reason_if_no_fault_detector_reacted():
    ledger, row = rows_of("4 s: drift imu[2] 0.15")
    assert row.notices == []
    assert set(row.silent_witnesses()) == {"monitor", "model", "supervisor", "gate", "nis"}
    reason = ledger.unnoticed_diagnostic(row)
    assert reason.code == "ledger.undetected-error"
    assert reason.figures["reason"].code == "ledger.why-drift"
    assert reason.figures["consequence"].figures["error_cm"] > 5.0
    ledger, row = rows_of("4 s: sag 84 %")
    assert ledger.reason_unnoticed(row.fault).code == "ledger.why-sag"
    ledger, row = rows_of("7.5 s: sag 84 %")
    assert ledger.unnoticed_diagnostic(row) is None  # too early for a verdict
