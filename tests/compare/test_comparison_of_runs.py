"""`compare` on synthetic runs whose figures are exactly known."""

import re

import numpy as np
import pytest

from baqueano.compare import compare
from baqueano.compare.consistency import NOT_REPORTED, Band
from baqueano.compare.divergence import InvalidCovariance
from baqueano.compare.filter_consistency import FilterConsistency
from baqueano.diagnostics import StopReason, fault, note
from baqueano.errors import UsageError
from baqueano.messages import language, text
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.monitor import Rejections, rejection_event
from baqueano.runs.run import EstimateLog, Event, ReferenceLog, Run, TruthLog
from tests.codes import refused

N = 1500


def run_with(name="a", offset=(0.03, 0.0, 0.0), distance=0.0, sigma=0.02, seed=0, innovation=True, **extra):
    """A straight drive at 1 m/s; the estimate is off by white noise of `sigma` and, at the end, by `offset`."""
    rng = np.random.default_rng(seed)
    t_ns = 10_000_000 * np.arange(1, N + 1)
    ref = np.column_stack([t_ns * 1e-9, np.zeros(N), np.zeros(N)])
    nu = np.tile([1.0, 0.0, 0.0], (N, 1))
    truth = ref + np.array([0.0, distance, 0.0])
    eta = truth + sigma * rng.standard_normal((N, 3)) + np.array(offset)
    cov = np.tile(np.diag([4e-4] * 6), (N, 1, 1))
    y = rng.standard_normal((N, 2)) if innovation else None
    S = np.tile(np.eye(2), (N, 1, 1)) if innovation else None
    log = EstimateLog(t_ns, eta, nu + 0.02 * rng.standard_normal((N, 3)), cov, y, S)
    parts = {
        "estimate": log,
        "reference": ReferenceLog(t_ns, ref, nu, np.zeros(N)),
        "truth": TruthLog(t_ns, truth, nu, 0 * nu),
    }
    return Run(name, None, t_ns, np.zeros((N, 3)), **(parts | extra))


def test_a_consistent_run_is_called_consistent():
    comparison = compare(run_with(offset=(0.0, 0.0, 0.0), distance=0.05))
    row = comparison.rows()[0]
    assert row["verdict"] == "consistent"
    assert comparison.verdict == "CONSISTENT"
    assert row["ate_m"] == pytest.approx(0.02 * np.sqrt(2), rel=0.1)
    assert row["across_true_rms_m"] == pytest.approx(0.05)
    assert row["across_estimate_rms_m"] == pytest.approx(np.hypot(0.05, 0.02), rel=0.05)
    assert abs(row["innovation_correlation"]) < 4 / np.sqrt(N)  # 4 σ, two channels: 1 in 8 000


def test_rejections_of_runs_are_compared_side_by_side():
    rejections = rejection_event([Rejections("imu[2]", 12, 800)])
    first = run_with(events=(Event(0, "info", "refused", "", rejections),))
    comparison = compare([first, run_with("b")])
    rows = comparison.rows()
    assert (rows[0]["rejections_imu[2]"], rows[0]["readings_imu[2]"]) == (12, 800)
    assert not any(key.startswith("refused") for key in rows[1])
    (line,) = [line for line in comparison.table().splitlines() if "imu[2]" in line]
    assert line.split()[-4:] == ["12", "of", "800", "-"]
    assert "refused" not in compare(run_with("b")).table()


def test_an_innovation_has_the_name_of_its_channel():
    counts = rejection_event([Rejections("imu[2]", 0, 800), Rejections("odometer[0]", 3, 90)])
    run_with_counts = run_with(events=(Event(0, "info", "refused", "", counts),))
    comparison = compare([run_with_counts, run_with("b", innovation=False)])
    assert list(comparison.runs[0].consistency.channels) == ["imu[2]", "odometer[0]"]
    assert "innovation 0" not in comparison.table()
    assert list(compare(run_with()).runs[0].consistency.channels) == ["innovation 0", "innovation 1"]


def test_a_small_nees_is_printed_with_its_digits():
    run = run_with(sigma=0.001)
    nees = compare(run).runs[0].consistency.states["heading"].mean
    (line,) = [line for line in compare(run).table().splitlines() if line.startswith("  heading  ")][-1:]
    assert float(line.split()[-3]) == pytest.approx(nees, rel=0.05)
    assert 0.0 < nees < 0.005


def test_an_estimate_with_errors_beyond_its_covariance_is_called_too_sure():
    comparison = compare([run_with(offset=(0, 0, 0)), run_with("b", offset=(0.2, 0.0, 0.0))])
    assert [row["verdict"] for row in comparison.rows()] == ["consistent", "too sure"]
    assert [(reason.subject, reason.figures["verdict"]) for reason in comparison.reasons] == [
        ("b", "too sure")
    ]
    assert " ".join(comparison.table().split()).endswith(text(note("compare.advice-too-sure")))


def test_an_overestimated_covariance_is_called_too_cautious_without_fit_advice():
    comparison = compare(run_with(offset=(0.0, 0.0, 0.0), sigma=0.01))
    assert [(reason.subject, reason.figures["verdict"]) for reason in comparison.reasons] == [
        ("a", "too cautious")
    ]
    table_text = " ".join(comparison.table().split())
    assert table_text.endswith(text(note("compare.advice-too-cautious")))
    assert text(note("compare.advice-too-sure")) not in table_text


def test_the_second_run_is_compared_with_the_path_of_the_first():
    rows = compare([run_with(distance=0.01), run_with("b", distance=-0.03)]).rows()
    assert np.isnan(rows[0]["across_first_rms_m"])
    assert rows[1]["across_first_rms_m"] == pytest.approx(0.04)


def test_figures_without_data_in_the_run_are_nan():
    row = compare(run_with(truth=None, reference=None, innovation=False)).rows()[0]
    assert np.isnan(row["ate_m"])
    assert np.isnan(row["across_true_rms_m"])
    assert row["verdict"] == "not reported"
    assert compare(run_with(estimate=None)).verdict == "NOT REPORTED"


def test_a_camera_without_velocities_still_judges_the_pose():
    run = run_with(offset=(0, 0, 0))
    blind = run.truth._replace(nu=np.full((N, 3), np.nan), nu_dot=np.full((N, 3), np.nan))
    row = compare(run_with(offset=(0, 0, 0), truth=blind)).rows()[0]
    assert np.isnan(row["speed_error_m_s"])
    assert row["nees_velocity_verdict"] == "not reported"
    assert row["verdict"] == "consistent"


def test_the_first_seconds_can_be_excluded_from_a_comparison():
    run = run_with()
    eta = run.estimate.eta.copy()
    eta[:100, 0] += 5.0
    run = run_with(estimate=run.estimate._replace(eta=eta))
    assert compare(run).rows()[0]["ate_m"] > 1.0
    assert compare(run, skip_s=1.0).rows()[0]["ate_m"] < 0.1


def test_the_table_has_a_column_per_run_and_the_verdict():
    text = compare([run_with(offset=(0.2, 0, 0)), run_with("0002-repeat", offset=(0.2, 0, 0))]).table()
    assert "0002-repeat" in text.splitlines()[0]
    assert "NEES, 1 if consistent" in text
    assert len([line for line in text.splitlines() if line.startswith("INCONSISTENT")]) == 1


@pytest.mark.parametrize("runs", [1, 2, 5])
def test_the_table_fits_80_columns_and_each_row_has_a_figure(runs):
    names = ["a", "0012-replay-0003-repeat-of-a-long-name", "b", "c", "d"][:runs]
    silent = run_with("a", innovation=False, events=(Event(0, "info", "refused", "imu[0]: 0 of 0"),))
    results = [silent, *(run_with(name) for name in names[1:])]
    text = compare(results).table()
    assert max(map(len, text.splitlines())) <= 80
    assert "of 0" not in text
    rows = [
        line for line in text.split("\n\na: ")[0].splitlines() if line.startswith("  ") and line[2] != " "
    ]
    assert rows
    assert all(re.search(r"\d|consistent|sure|tell|cautious", row[30:]) for row in rows)


def test_the_short_table_of_a_drive_begins_with_its_path_and_fits_25_lines():
    comparison = compare(run_with(offset=(0.2, 0.0, 0.0)))
    full, short = (
        words.split("\n\n")[0].splitlines() for words in (comparison.table(), comparison.short_table())
    )
    assert len(short) <= 25 < len(full)
    assert {line.strip()[:13] for line in short} <= {line.strip()[:13] for line in full}
    path_row, pose_row = (
        next(k for k, line in enumerate(short) if word in line) for word in ("largest", "ATE")
    )
    assert path_row < pose_row
    assert comparison.short_table().split("\n\n")[1:] == comparison.table().split("\n\n")[1:]


@pytest.mark.parametrize("tongue", ["en", "es"])
def test_a_command_in_the_advice_stays_in_one_line(tongue):
    with language.use_language(tongue), use_notation(COMMAND_LINE):
        lines = compare(run_with(offset=(0.0, 0.0, 0.0), sigma=0.001)).table().splitlines()
    assert any("baqueano identify last --update" in line for line in lines)


@pytest.mark.parametrize("columns", ["en", "es"])
def test_two_drives_stand_side_by_side(columns):
    with language.use_language(columns):
        drives = [
            run_with(name, offset=(0.0, 0.0, 0.0), sigma=0.001) for name in ("0004-repeat", "0005-repeat")
        ]
        lines = compare(drives).table().splitlines()
    assert lines[0].split() == ["0004-repeat", "0005-repeat"]
    assert sum(line.startswith("0004-repeat, 0005-repeat: ") for line in lines) == 1  # the advice
    assert max(map(len, lines)) <= 80


def test_a_printed_comparison_begins_with_a_line_for_each_run():
    runs = [run_with(name, offset=(0.2, 0, 0)) for name in ("ours", "mine", "third")]
    begins = [line.split(",")[0] for line in repr(compare(runs)).splitlines() if not line.startswith(" ")]
    assert begins[:3] == ["ours", "mine", "third"]


def test_a_replay_is_judged_only_by_its_estimate():
    drive = run_with("drive", distance=0.05)
    replayed_run = run_with("replay", distance=0.05, metadata={"kind": "replay"})
    text = compare([drive, replayed_run]).table()
    assert "cross-track" not in text
    assert "at a limit" not in text
    assert "position (ATE)" in text
    assert "cross-track error of the vehicle" in compare(drive).table()


def test_an_estimator_that_raised_is_not_called_diverged():
    """The sentence contains the error, its line, and the command that tests the block."""
    block = {"role": "estimator", "kind": "/lab/my.py:Mine", "block": "estimator Mine (/lab/my.py:7)"}
    cause = fault(StopReason.BLOCK_RAISED, **block, error="ValueError: no")
    log = run_with().estimate
    events = (Event(int(log.t_ns[0]), "error", "loop", "", cause),)
    comparison = compare(run_with(estimate=log._replace(eta=log.eta * np.nan), events=events))
    assert (comparison.runs[0].verdict, comparison.verdict) == ("failed", "INCONSISTENT")
    sentence = " ".join(comparison.table().split())
    assert text(cause) in sentence
    assert text(comparison.runs[0].failure) in sentence
    assert comparison.runs[0].failure.fix == "baqueano blocks check /lab/my.py:Mine"
    assert "diverged" not in sentence


def test_an_estimator_that_raised_during_the_rest_is_called_failed():
    cause = fault(StopReason.BLOCK_RAISED, role="estimator", kind="/lab/my.py:Mine", block="", error="no")
    run = run_with(events=(Event(10_000_000, "error", "loop", "", cause),), metadata={"rest_s": "2"})
    lost_log = run.estimate._replace(eta=run.estimate.eta * np.nan, cov=run.estimate.cov * np.nan)
    comparison = compare(run_with(estimate=lost_log, events=run.events, metadata=run.metadata))
    assert (comparison.runs[0].verdict, comparison.verdict) == ("failed", "INCONSISTENT")
    assert comparison.runs[0].failure.figures["t_s"] == 0.0
    assert not any(line.rstrip().endswith(":") for line in repr(comparison).splitlines())


def test_a_diverged_estimate_is_judged_until_its_divergence():
    run = run_with(offset=(0, 0, 0))
    eta = run.estimate.eta.copy()
    eta[700:, 0] = 1e16
    comparison = compare(run_with(estimate=run.estimate._replace(eta=eta)))
    assert comparison.runs[0].divergence_s == pytest.approx(7.0, abs=0.02)
    assert comparison.runs[0].ate_m < 0.05
    assert (comparison.verdict, comparison.reasons[0].figures["verdict"]) == ("INCONSISTENT", "diverged")
    assert text(note("compare.diverged", t_s=comparison.runs[0].divergence_s)) in comparison.table()
    assert np.isnan(compare(run_with()).runs[0].divergence_s)


def test_an_invalid_covariance_is_named():
    run = run_with(offset=(0, 0, 0))
    cov = run.estimate.cov.copy()
    cov[100:] *= -1.0
    comparison = compare(run_with(estimate=run.estimate._replace(cov=cov)))
    assert comparison.runs[0].invalid_covariance == InvalidCovariance(N - 100, N, pytest.approx(1.0))
    assert comparison.verdict == "INCONSISTENT"
    figures = comparison.runs[0].invalid_covariance._asdict()
    assert text(note("compare.no-covariance", **figures)) in " ".join(comparison.table().split())


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: compare([]), ("compare.no-runs", {})),
        (lambda: compare(run_with(), interval_s=0.0), ("compare.times", {"interval_s": 0.0, "skip_s": 0.0})),
        (
            lambda: compare(run_with(), alignment="sim"),
            ("compare.alignment", {"valid": "none, start, rigid"}),
        ),
        (lambda: compare(run_with(), names=["a", "b"]), ("compare.names", {"names": 2, "runs": 1})),
    ],
)
def test_an_invalid_comparison_is_refused_with_a_reason(call, words):
    with refused(words[0], UsageError, **words[1]):
        call()


def test_one_sentence_names_the_figure_and_state_with_the_largest_deviation():
    comparison = compare(run_with(offset=(0.0, 0.2, 0.0)))
    sentence, (message, *_) = comparison.rows()[0]["sentence"], comparison.runs[0].consistency.messages
    assert (message.code, message.figures["figure"], message.figures["quantity"]) == (
        "consistency.too-sure",
        "NEES",
        "the pose",
    )
    worst = message.figures["worst"]
    assert (worst.code, worst.figures["state"]) == ("consistency.worst", "y")
    assert worst.figures["nees"] == comparison.rows()[0]["nees_y"] > 50.0
    assert sentence.replace(" ", "") in comparison.table().replace("\n", "").replace(" ", "")


def test_a_run_of_a_few_ticks_gives_no_verdict():
    comparison = compare(run_with(offset=(0.0, 0.0, 0.0)).cut(0.0, 0.05))
    assert comparison.verdict == "CANNOT TELL"
    (message,) = comparison.runs[0].consistency.messages
    assert message.code == "consistency.cannot-tell"


def test_innovations_are_judged_without_a_truth():
    right = Band(1.0, 0.9, 1.1, 3, 900.0)
    wide_band = Band(2.0, 0.9, 1.1, 3, 900.0)
    small_sample = Band(2.0, 0.2, 4.0, 3, 2.0)

    def verdict(pose, nis):
        return FilterConsistency(pose, NOT_REPORTED, nis, {}, {}, (0.5,), 0.05)

    assert verdict(small_sample, wide_band).verdict == "too sure"
    assert verdict(small_sample, right).verdict == "cannot tell"
    assert verdict(right, wide_band).verdict == "consistent"
    assert verdict(NOT_REPORTED, right).verdict == "consistent"
    drift = FilterConsistency(small_sample._replace(mean=1.0), right, right, {}, {}, (), np.nan)
    assert drift.verdict == "consistent"
    (first, second), (_, correlation_note) = drift.messages, verdict(NOT_REPORTED, right).messages
    assert (first.code, first.figures["quantity"], first.figures["mean"]) == (
        "consistency.consistent",
        "the velocity",
        1.0,
    )
    assert (second.code, second.figures) == ("consistency.unknown", {"quantity": "the pose"})
    assert (correlation_note.code, correlation_note.figures) == (
        "consistency.correlated",
        {"correlation": 0.5},
    )
    assert verdict(NOT_REPORTED, NOT_REPORTED).verdict == "not reported"
