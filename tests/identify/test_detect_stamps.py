"""Wrong times: the run is split, spread or reported, and never integrated across a wrong time."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.diagnostics import Severity
from baqueano.identify import identify
from baqueano.runs.diagnostics.timestamps import check_timestamps, spread_bursts
from baqueano.runs.run import Channel


def move_stamps(run, move):
    sensors = {n: Channel(move(c.t_ns), move(c.arrival_ns), c.z) for n, c in run.sensors.items()}
    return replace(run, t_ns=move(run.t_ns), sensors=sensors, truth=None)


def codes(findings):
    return [finding.code for finding in findings]


def test_a_sound_run_is_returned_unchanged(case_run):
    run = case_run(0, 20.0)
    pieces, findings = check_timestamps(run, 100.0)
    assert findings == []
    assert pieces == [run]


def test_id3_half_a_step_of_jitter_is_not_a_burst(case_run):
    run = case_run(0, 20.0)
    jitter = np.random.default_rng(0).uniform(-0.45e7, 0.45e7, len(run.t_ns)).astype(np.int64)
    pieces, findings = check_timestamps(move_stamps(run, lambda t: t + jitter), 100.0)
    assert findings == []
    assert len(pieces) == 1


def test_id3_a_clock_jump_of_one_day_splits_the_run(case_run, case, normalised_errors):
    run = case_run(0, 20.0)
    jump = move_stamps(run, lambda t: t + np.where(t >= run.t_ns[900], 86_400 * 10**9, 0))
    pieces, findings = check_timestamps(jump, 100.0)
    assert [len(piece.t_ns) for piece in pieces] == [900, 1100]
    assert codes(findings) == ["time.jump"]
    assert findings[0].severity == Severity.INFO
    fit = identify(jump, case)
    assert np.max(np.abs(normalised_errors(fit, case))) < 4.5
    assert [note.figures["jumps"] for note in fit.notes if note.code == "time.jump"] == [1]


def test_a_run_whose_clock_jumps_repeatedly_is_not_split(case_run):
    run = case_run(0, 20.0)
    jumps = move_stamps(run, lambda t: t + 60 * 10**9 * ((t - run.t_ns[0]) // 10**9))
    pieces, messages = check_timestamps(jumps, 100.0)
    (finding,) = (finding for finding in messages if finding.code.startswith("time.jump"))
    assert (finding.code, finding.severity) == ("time.jump-throughout", Severity.ERROR)
    assert len(pieces) == 1


@pytest.mark.parametrize(
    ("factor", "guess"), [(1000.0, "milliseconds-as-seconds"), (0.001, "seconds-as-milliseconds")]
)
def test_a_clock_in_another_unit_is_refused_and_the_unit_is_named(case_run, case, factor, guess):
    run = case_run(0, 20.0)
    first = run.t_ns[0]
    moved_run = move_stamps(run, lambda t: first + np.rint((t - first) * factor).astype(np.int64))
    fit = identify(moved_run, case)
    assert fit.verdict == "REFUSED"
    (reason,) = (candidate for candidate in fit.reasons if candidate.code == "time.unit")
    assert reason.figures["rate_hz"] == 100.0
    assert reason.figures["guess"].code == f"time.{guess}"


def test_timestamps_of_bursts_are_spread_evenly_between_their_ends():
    regular = np.arange(1, 101) * 10_000_000
    last = np.minimum((np.arange(100) // 5 + 1) * 5 - 1, 99)
    burst = regular[last] - (last - np.arange(100)) * 10_000
    assert np.max(np.abs(spread_bursts(burst) - regular)) < 10_000


def test_a_sensor_stamped_in_bursts_is_fitted_with_a_warning(case_run, case, normalised_errors):
    run = case_run(0, 20.0)
    c = run.sensors["imu"]
    last = np.minimum((np.arange(len(c.t_ns)) // 6 + 1) * 6 - 1, len(c.t_ns) - 1)
    imu = Channel(c.t_ns[last] - (last - np.arange(len(last))) * 20_000, c.arrival_ns[last], c.z)
    fit = identify(replace(run, sensors={"imu": imu}), case)
    assert fit.verdict == "WARN"
    assert (fit.reasons[0].code, fit.reasons[0].subject) == ("time.bursts", "imu")
    assert np.max(np.abs(normalised_errors(fit, case))) < 4.5


def test_samples_with_wrong_timestamps_are_excluded(case_run, case, normalised_errors):
    run = case_run(0, 20.0)
    c = run.sensors["imu"]
    mask = np.arange(len(c.t_ns)) > 1200
    imu = c._replace(t_ns=c.t_ns - mask * 3600 * 10**9)
    pieces, findings = check_timestamps(replace(run, sensors={"imu": imu}), 100.0)
    assert len(pieces[0].sensors["imu"].t_ns) == 1201
    assert (findings[0].code, findings[0].severity) == ("time.stamps-far", Severity.WARNING)
    fit = identify(replace(run, sensors={"imu": imu}), case)
    assert np.max(np.abs(normalised_errors(fit, case))) < 4.5


def test_id3_samples_with_repeated_timestamps_are_excluded(case_run):
    run = case_run(0, 20.0)
    c = run.sensors["imu"]
    t_ns = c.t_ns.copy()
    t_ns[100:200:10] = t_ns[99:199:10]
    pieces, findings = check_timestamps(replace(run, sensors={"imu": c._replace(t_ns=t_ns)}), 100.0)
    assert len(pieces[0].sensors["imu"].t_ns) == len(t_ns) - 10
    assert (findings[0].code, findings[0].figures["count"]) == ("time.stamps-back", 10)
