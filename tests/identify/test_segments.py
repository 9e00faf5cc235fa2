"""A run in segments: the same parameters, correct errors, and poses that a simulation of the whole run could not
follow.
"""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify
from baqueano.identify.data.record import make_record, split_record
from baqueano.identify.parameters.theta import ThetaLayout, eliminate_starts
from baqueano.numerics.normal_equations import projected_derivatives, pseudo_inverse
from baqueano.runs.run import TruthLog
from baqueano.simulate import simulate
from tests.codes import of_code

FREE = ("model.friction.linear[0]", "model.friction.linear[2]", "model.actuator_matrix[0,0]")


def test_segments_contain_every_measurement_once(case, case_run):
    record = make_record(case_run(0, 12.0), case.sensors._asdict())
    pieces = split_record(record, 2.5, 0.3)
    assert len(pieces) == 5
    assert [p.lead for p in pieces] == [0, 30, 30, 30, 30]
    assert sum(p.sensors["imu"].mask.sum() for p in pieces) == record.sensors["imu"].mask.sum()
    times_kept = np.concatenate([p.t_s[p.lead :] for p in pieces])
    np.testing.assert_array_equal(times_kept, record.t_s)


def test_a_segment_begins_before_its_first_measurement(case, case_run):
    record = make_record(case_run(0, 12.0), case.sensors._asdict())
    pieces = split_record(record, 2.5, 0.0)
    assert [p.lead for p in pieces] == [0, 1, 1, 1, 1]
    assert all(not p.sensors["imu"].mask[: p.lead].any() for p in pieces)


def test_measurements_before_the_first_tick_are_ignored(case, case_run):
    run = case_run(0, 3.0)
    imu = run.sensors["imu"]
    t_ns = imu.t_ns - 2_000_000
    early_run = replace(run, sensors={"imu": imu._replace(t_ns=t_ns)})
    mask = make_record(early_run, case.sensors._asdict()).sensors["imu"].mask
    assert not mask[0].any()
    assert mask[1:].all()


def test_a_reading_within_a_long_tick_belongs_to_the_row_of_its_time(case, case_run):
    """Ticks of 50 ms have three rows: a reading 30 ms before a tick is in the second, at a part of it."""
    run = case_run(0, 3.0)
    imu = run.sensors["imu"]
    at_ns = run.t_ns[4::5][1:] - 30_000_000
    readings = imu._replace(t_ns=at_ns, arrival_ns=at_ns, z=imu.z[: len(at_ns)])
    slow = replace(
        run,
        t_ns=run.t_ns[4::5],
        applied_commands=run.applied_commands[4::5],
        sensors={"imu": readings},
        truth=None,
    )
    record = make_record(slow, case.sensors._asdict())
    _, mask, part, *_ = record.sensors["imu"]
    rows = np.flatnonzero(mask[:, 0])
    assert np.all(rows % 3 == 1)
    before_s = record.t_s[rows + 1] - record.t_s[rows] + part[rows] * record.dt_s[rows]
    np.testing.assert_allclose(before_s, 0.03)


def test_a_segment_longer_than_the_run_is_the_whole_run(case, case_run):
    record = make_record(case_run(0, 4.0), case.sensors._asdict())
    (piece,) = split_record(record, 60.0, 0.5)
    assert piece.lead == 0
    np.testing.assert_array_equal(piece.u, record.u)


def test_eliminating_initial_states_gives_the_inverse_of_the_whole_information():
    rng = np.random.default_rng(0)
    layout = ThetaLayout(3, 2, 2, (0, 0, 1))
    J = np.zeros((60, layout.size))
    for k, index in enumerate(layout.indices):
        J[20 * k : 20 * (k + 1), index] = rng.normal(size=(20, len(index)))
    A = J.T @ J
    without_start, meat = eliminate_starts(A, A, layout)
    starts = layout.first_start
    np.testing.assert_allclose(np.linalg.inv(without_start), np.linalg.inv(A)[:starts, :starts], rtol=1e-9)
    np.testing.assert_allclose(meat, without_start, rtol=1e-9, atol=1e-12)


def test_derivatives_with_initial_states_eliminated_give_the_reduced_information():
    rng = np.random.default_rng(1)
    layout = ThetaLayout(3, 2, 2, (0, 0, 1))
    A = np.zeros((layout.size, layout.size))
    without_start = np.zeros((layout.first_start, layout.first_start))
    for index in layout.indices:
        d, w = rng.normal(size=(20, 2, len(index))), (rng.random((20, 2)) < 0.8).astype(float)
        A[np.ix_(index, index)] += np.einsum("tm,tmp,tmq->pq", w, d, d)
        start = index >= layout.first_start
        slopes = projected_derivatives(d, w, start)
        np.testing.assert_allclose(np.einsum("tm,tmp,tmq->pq", w, slopes, d[..., start]), 0.0, atol=1e-12)
        without_start[np.ix_(index[~start], index[~start])] += np.einsum("tm,tmp,tmq->pq", w, slopes, slopes)
    np.testing.assert_allclose(without_start, eliminate_starts(A, A, layout)[0], rtol=1e-9, atol=1e-12)


def test_a_segmented_fit_is_correct_with_slightly_larger_errors(case, case_run, normalised_errors):
    run = case_run(3, 40.0)
    full_fit = identify(run, case, FREE)
    pieces = identify(run, case, FREE, options=FitOptions(segment_s=4.0))
    assert np.max(np.abs(normalised_errors(pieces, case))) < 4.0
    assert np.all(pieces.std > 0.9 * full_fit.std)
    assert np.all(pieces.std < 4.0 * full_fit.std)
    assert pieces.channels[0].t_s.shape == full_fit.channels[0].t_s.shape
    assert pieces.runs == full_fit.runs
    assert pieces.run_entries.shape == (1, 3)  # biases; the starts are of no interest


@pytest.mark.parametrize(("seed", "segment_s"), [(1, 5.0), (4, 5.0), (6, 2.0), (6, 10.0)])
def test_initial_slip_of_segments_does_not_slow_the_search(small, seed, segment_s):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, (60, 3)) * [1.0, 0.0, 1.0], 50, axis=0)
    fit = identify(simulate(small, u, seed), small, options=FitOptions(segment_s=segment_s, diagnose=False))
    assert fit.converged
    assert fit.evaluations < 60  # 424 to 800 if a segment may begin with any slip


def test_several_cores_give_the_same_fit_as_a_single_core(case, case_run, monkeypatch):
    runs = [case_run(k, 25.0) for k in range(2)]
    joint = identify(runs, case, FREE)
    monkeypatch.setattr(import_module("baqueano.numerics.parallel"), "MIN_ROWS", 10**9)
    serial = identify(runs, case, FREE)
    np.testing.assert_array_equal(joint.estimate, serial.estimate)
    np.testing.assert_array_equal(joint.cov, serial.cov)


def test_a_parameter_may_have_a_different_value_in_each_run(case, case_run):
    scales = (1.0, 1.05)
    runs = [case_run(k, 15.0, case.with_values({"sensors.imu.gyro_scale": s})) for k, s in enumerate(scales)]
    fit = identify(
        runs, case, ["model.friction.linear[0]"], options=FitOptions(per_run=["sensors.imu.gyro_scale"])
    )
    k = fit.run_entry_names.index("sensors.imu.gyro_scale")
    assert np.max(np.abs(fit.run_entries[:, k] - scales) / fit.run_entry_std[:, k]) < 4.0
    assert np.all(fit.run_entry_std[:, k] < 0.01)


@pytest.fixture(scope="module")
def filmed_run(small):
    """A drive of the small vehicle whose camera clock is 40 ms off and whose gyro measures too much."""
    from baqueano.identify import random_steps

    file = small.with_values({"sensors.imu.gyro_scale": 1.04})
    u = random_steps(file.command.limit, 40.0, file.rate_hz, 5)
    run = simulate(file, u, 5)
    rng = np.random.default_rng(1)
    t = run.truth
    rows = slice(3, None, 4)
    eta = t.eta[rows] + rng.normal(size=t.eta[rows].shape) * [2e-3, 2e-3, 5e-3]
    none = np.full_like(eta, np.nan)
    return replace(run, truth=TruthLog(t.t_ns[rows] - 40_000_000, eta, none, none))


@pytest.mark.long
def test_a_camera_identifies_the_gyro_scale_and_the_camera_clock(filmed_run, small):
    fit = identify(
        filmed_run,
        small,
        ["model.actuator_matrix[2,2]", "model.friction.linear[2]", "sensors.imu.gyro_scale"],
        use=("imu", "truth"),
        options=FitOptions(clocks=("truth",), segment_s=2.0),
    )
    k, c = fit.names.index("sensors.imu.gyro_scale"), fit.run_entry_names.index("clock.truth")
    assert abs(fit.estimate[k] - 1.04) < 4.0 * fit.std[k] + 1e-3
    assert fit.std[k] < 0.005
    assert abs(fit.run_entries[0, c] - 0.040) < 0.005
    assert fit.run_entry_std[0, c] < 0.005


def test_a_free_clock_of_an_unused_sensor_is_refused(case, case_run):
    with pytest.raises(UsageError, check=of_code("clock.unreliable", valid="imu")):
        identify(case_run(0, 3.0), case, FREE, options=FitOptions(clocks=("truth",)))


def test_a_delay_is_refused_if_the_clocks_of_all_sensors_are_free(case, case_run):
    delay = "model.drivetrain.delay_s"
    with pytest.raises(UsageError, check=of_code("clock.all-free", clocks="imu", path=delay)):
        identify(case_run(0, 3.0), case, [*FREE, delay], options=FitOptions(clocks=("imu",)))


def test_segments_need_a_positive_length_and_several_rows(case, case_run):
    with pytest.raises(UsageError, check=of_code("segment.short", rows=10, shortest_s=pytest.approx(0.1))):
        identify(case_run(0, 3.0), case, FREE, options=FitOptions(segment_s=0.05))
    with pytest.raises(UsageError, check=of_code("segment.length", length_s=0.0)):
        identify(case_run(0, 3.0), case, FREE, options=FitOptions(segment_s=0.0))


def test_an_entry_without_information_has_a_pseudo_inverse_of_zero():
    """At a saddle of the likelihood the curvature of an entry is negative; an overflow there once ended a fit."""
    A = np.array([[4.0, 1e10, 0.0], [1e10, -1e-3, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(pseudo_inverse(A), np.diag([0.25, 0.0, 0.0]))
