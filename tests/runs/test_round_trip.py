"""A run that was written and read back is the same run, bit by bit; its ticks are those that the loop received."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as hnp

from baqueano.diagnostics import Severity, StopReason, note, stop
from baqueano.drive import drive_stop_reason
from baqueano.errors import FileError, UsageError
from baqueano.messages import text
from baqueano.runs import Channel, EstimateLog, Event, Run, RunWriter, read_run, write_run
from baqueano.runs.container.writer import versions
from baqueano.signals import Command, Estimate, Motion, Reference, Slot, Tick, sensor_slots
from tests.codes import refused
from tests.runs.conftest import make_record

doubles = st.floats(width=64, allow_nan=True, allow_infinity=True, allow_subnormal=True)


def test_a_run_written_and_read_back_is_equal_bit_by_bit(run, tmp_path):
    read_back = read_run(write_run(run, tmp_path / "0001-José Núñez.mcap"))
    assert read_back == run
    assert read_back.notes == ()
    assert read_back.name == "0001-José Núñez"
    assert list(read_back.sensors) == ["imu", "odometer"]


@settings(max_examples=40)
@given(u=hnp.arrays(float, (4, 2), elements=doubles), z=hnp.arrays(float, (4, 3), elements=doubles))
def test_every_double_is_read_back_exactly(tmp_path_factory, u, z):
    t_ns = np.array([1, 2, 5, 2**31 * 10**9 - 1])
    run = Run("x", None, t_ns, u, sensors={"imu": Channel(t_ns, t_ns, z)}, metadata={"a": "b"})
    assert read_run(write_run(run, tmp_path_factory.mktemp("runs") / "x.mcap")) == run


@pytest.mark.parametrize(
    "change",
    [
        {"requested_commands": None, "sent_commands": None},
        {"estimate": None, "reference": None, "truth": None},
        {"sensors": {}},
        {"events": ()},
        {"vehicle_text": "", "metadata": {}},
    ],
)
def test_data_absent_from_a_run_are_absent_after_reading(run, change, tmp_path):
    run = replace(run, **change)
    assert read_run(write_run(run, tmp_path / "x.mcap")) == run


def test_an_estimate_without_innovations_is_read_back_unchanged(run, tmp_path):
    for innovation in (None, run.estimate.innovation):
        variant = replace(run, estimate=EstimateLog(*run.estimate[:4], innovation, None))
        assert read_run(write_run(variant, tmp_path / f"{innovation is None}.mcap")) == variant


def test_a_run_without_ticks_is_read_back(make_run, tmp_path):
    no_rows = make_run(N=0)
    read_back = read_run(write_run(no_rows, tmp_path / "x.mcap"))
    assert read_back == no_rows
    assert read_back.applied_commands.shape == (0, 3)
    assert list(read_back.ticks()) == []
    assert read_back.duration_s == 0.0


def test_two_runs_are_equal_if_all_recorded_bits_are_equal(run):
    assert run == replace(run, name="other", path=None, notes=(note("run.metadata-lost"),))
    applied_commands = run.applied_commands.copy()
    applied_commands[7, 1] = np.nextafter(applied_commands[7, 1], 1e9)
    assert run != replace(run, applied_commands=applied_commands)
    assert run != replace(run, sensors=dict(reversed(run.sensors.items())))
    assert run != "a run"


def test_a_tick_contains_the_newest_measurement_since_the_previous_tick():
    t_ns = np.array([10, 20, 30, 40])
    arrival = np.array([5, 9, 20, 31, 39, 45])
    z = np.arange(6.0)[:, None]
    run = Run("x", None, t_ns, np.zeros((4, 1)), sensors={"a": Channel(arrival - 3, arrival, z)})
    rows = [(tick.t_ns, tick.sensors.a.is_new, float(tick.sensors.a.z[0])) for tick in run.ticks()]
    assert rows == [(10, 1.0, 1.0), (20, 1.0, 2.0), (30, 0.0, 0.0), (40, 1.0, 4.0)]


def test_a_cut_run_has_the_same_ticks_as_the_whole_run(run):
    piece = run.cut(0.5, 1.2)
    expected = [tick for tick in run.ticks() if piece.t_ns[0] <= tick.t_ns <= piece.t_ns[-1]]
    for a, b in zip(piece.ticks(), expected, strict=True):
        assert (a.t_ns, a.u.tobytes()) == (b.t_ns, b.u.tobytes())
        assert all(
            x.is_new == y.is_new and x.z.tobytes() == y.z.tobytes()
            for x, y in zip(*(t.sensors for t in (a, b)), strict=True)
        )
    assert 0.5 <= (piece.t_ns[0] - run.t_ns[0]) * 1e-9 < 0.52
    assert piece.metadata["cut"] == "0.5 s to 1.2 s of 0001-test"
    assert len(run.cut().t_ns) == len(run.t_ns)


def records(run, sensors):
    """Return the records that the loop would pass to a writer."""
    for k, tick in enumerate(run.ticks()):
        t_ns, e, r = tick.t_ns, run.estimate, run.reference
        estimate = Estimate(t_ns, e.eta[k], e.nu[k], e.cov[k], e.innovation[k], e.innovation_cov[k])
        reference = Reference(t_ns, r.eta[k], r.nu[k], r.at_end[k])
        requested_command = Command(t_ns, run.requested_commands[k])
        sent_command = Command(t_ns, run.sent_commands[k])
        commands = {"requested_command": requested_command, "sent_command": sent_command}
        yield make_record(tick, **commands, estimate=estimate, reference=reference)


def test_a_run_recorded_by_ticks_equals_a_run_written_at_once(run, tmp_path):
    path = tmp_path / "folder" / "0001-live.mcap"
    with RunWriter(path, run.vehicle_text, run.metadata) as writer:
        for k, record in enumerate(records(run, run.sensors)):
            writer.record(record)
            t = run.truth
            writer.truth(record.tick.t_ns, Motion(t.eta[k], t.nu[k], t.nu_dot[k], np.zeros(2)))
        writer.event(*run.events[0][:4])
    read_back = read_run(path)
    assert read_back == replace(run, metadata=versions() | run.metadata)
    assert read_back.notes == ()


def test_diagnostics_of_events_are_read_back_unchanged(run, tmp_path):
    cause = stop(StopReason.UNO_RESET, cause="brown-out")
    message = note(
        "drive.line-stopped", Severity.WARNING, "look", lost_frames=3, share=1.0 / 3.0, cause=cause
    )
    with RunWriter(tmp_path / "x.mcap", run.vehicle_text) as writer:
        for record in records(run, run.sensors):
            writer.record(record)
        writer.event(5, "warning", "line", message)
        writer.event(6, "error", "loop", cause)
    read_back = read_run(tmp_path / "x.mcap")
    assert [event.diagnostic for event in read_back.events] == [message, cause]
    assert [event.text for event in read_back.events] == [text(message), text(cause)]
    assert drive_stop_reason(read_back) == cause
    assert drive_stop_reason(replace(read_back, events=(Event(6, "error", "loop", "in words"),))) == stop(
        StopReason.RECORDED, words="in words"
    )


def silent_tick(t_ns, u=(0.0, 0.0)):
    return Tick(t_ns, np.array(u), sensor_slots(("imu",))(Slot(0.0, np.zeros(3))))


def test_ticks_without_controller_or_estimate_are_recorded(tmp_path):
    path = tmp_path / "x.mcap"
    with RunWriter(path) as writer:
        for t_ns in (0, 10):
            writer.record(make_record(silent_tick(t_ns)))
        command = Command(20, np.array([0.1, 0.2]))
        writer.record(make_record(silent_tick(20), requested_command=command))
    run = read_run(path)
    assert run.sensors["imu"].z.shape == (0, 3)
    assert np.isnan(run.requested_commands[:2]).all()
    assert run.requested_commands[2].tolist() == [0.1, 0.2]
    assert run.sent_commands is None


def test_data_of_a_wrong_shape_do_not_stop_the_recording(tmp_path):
    path = tmp_path / "x.mcap"
    with RunWriter(path) as writer:
        for t_ns in range(0, 50, 10):
            estimate = Estimate(t_ns, np.zeros(2), np.zeros(3), np.eye(6))
            writer.record(make_record(silent_tick(t_ns), estimate=estimate))
    run = read_run(path)
    assert len(run.t_ns) == 5
    assert run.estimate is None or len(run.estimate.t_ns) == 0
    assert [event.diagnostic.code for event in run.events] == ["run.not-packed"]


def test_missing_early_innovations_are_filled_with_nan(tmp_path):
    path = tmp_path / "x.mcap"
    with RunWriter(path) as writer:
        for t_ns, extra in ((0, ()), (10, (np.ones(3), np.eye(3)))):
            estimate = Estimate(t_ns, np.zeros(3), np.zeros(3), np.eye(6), *extra)
            writer.record(make_record(silent_tick(t_ns), estimate=estimate))
    innovation = read_run(path).estimate.innovation
    assert np.isnan(innovation[0]).all()
    assert innovation[1].tolist() == [1.0, 1.0, 1.0]


def test_an_exception_is_logged_in_the_run_and_raised_again(tmp_path):
    path = tmp_path / "x.mcap"

    def drive():
        with RunWriter(path) as writer:
            writer.record(make_record(silent_tick(5)))
            raise ZeroDivisionError("a block's")

    with pytest.raises(ZeroDivisionError):
        drive()
    run = read_run(path)
    assert run.notes == ()
    assert run.events == (Event(5, "error", "run writer", "ended by ZeroDivisionError: a block's"),)


def test_existing_runs_are_never_overwritten(run, tmp_path):
    write_run(run, tmp_path / "x.mcap")
    with refused("runs.run-there", FileError):
        write_run(run, tmp_path / "x.mcap")
    with refused("runs.run-there", FileError):
        RunWriter(tmp_path / "x.mcap")


def test_a_run_that_is_saved_into_a_folder_receives_the_next_number(run, tmp_path):
    """So a cell of a notebook can be executed again."""
    paths = [run.save(tmp_path / "runs") for _ in range(2)]
    assert [path.name[:5] for path in paths] == ["0001-", "0002-"]
    assert all(read_run(path) == run for path in paths)


def test_a_run_is_not_saved_under_the_ending_of_another_format(run, tmp_path):
    """Before, run.csv received the bytes of an MCAP file."""
    with refused("runs.ending", UsageError, name="run.mcap"):
        run.save(tmp_path / "run.csv")
    assert not list(tmp_path.iterdir())


def test_a_run_before_1970_is_refused(run, tmp_path):
    with refused("runs.times", UsageError):
        write_run(replace(run, t_ns=run.t_ns - 2 * run.t_ns[0]), tmp_path / "x.mcap")
    assert list(tmp_path.iterdir()) == []


def test_metadata_must_be_text(run, tmp_path):
    with refused("runs.metadata", UsageError, key="seed", value="7"):
        write_run(replace(run, metadata={"seed": 7}), tmp_path / "x.mcap")


ONE, TWO, BACK = np.array([1]), np.array([1, 2]), np.array([2, 1])
COV = EstimateLog(ONE, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3, 3)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t_ns": np.array([1, 1])}, ("run.times-not-increasing", {"entry": 0, "t_ns": 1, "next_ns": 1})),
        ({"t_ns": np.array([0.1, 0.2])}, ("run.times", {"dtype": "float64"})),
        (
            {"applied_commands": np.zeros((3, 1))},
            ("run.shape", {"name": "applied_commands", "value": "(3, 1)", "expected": "(2, 1)"}),
        ),
        (
            {"applied_commands": np.zeros(2)},
            ("run.shape", {"name": "applied_commands", "value": "(2,)", "expected": "(2, n)"}),
        ),
        (
            {"requested_commands": np.zeros((2, 2))},
            ("run.shape", {"name": "requested_commands", "value": "(2, 2)", "expected": "(2, 1)"}),
        ),
        (
            {"sensors": {"imu": Channel(ONE, TWO, np.zeros((2, 3)))}},
            ("run.arrivals", {"times": 1, "arrivals": 2}),
        ),
        ({"sensors": {"imu": Channel(TWO, BACK, np.zeros((2, 3)))}}, ("run.times-decreasing", {"entry": 0})),
        ({"estimate": COV}, ("run.shape", {"name": "estimate.cov"})),
    ],
)
def test_a_run_with_arrays_of_wrong_shape_is_refused(change, message):
    with refused(message[0], ValueError, **message[1]):
        Run(**{"name": "x", "path": None, "t_ns": TWO, "applied_commands": np.zeros((2, 1))} | change)
