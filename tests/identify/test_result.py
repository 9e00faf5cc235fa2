"""A fit as rows, table and vehicle file; every request that cannot be answered is refused with a message."""

import json
from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.data.record import make_record
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.runs.diagnostics.cleaning import unused_sensors
from baqueano.runs.run import Channel
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from tests.codes import of_code


@pytest.fixture(scope="module")
def fit(case, case_run):
    return identify(case_run(0, 20.0), case)


def test_rows_are_flat_and_serialisable_to_json(fit):
    rows = fit.rows()
    assert json.loads(json.dumps(rows)) == rows
    assert [row["name"] for row in rows] == list(fit.names)
    assert set(rows[0]) == {"name", "estimate", "std", "unit", "start", "bound", "identifiable"}


def test_table_has_estimate_deviation_unit_and_verdict(fit):
    lines = fit.table().splitlines()
    assert lines[1].startswith("friction.linear[0]")
    assert "±" in lines[1]
    assert lines[1].endswith("N s/m")
    assert any(line.startswith("USABLE: ") for line in lines)


def test_a_channel_that_the_model_does_not_explain_has_no_negative_percentage(fit):
    channels = (fit.channels[0]._replace(explained_fraction=-0.634), *fit.channels[1:])
    table = replace(fit, channels=channels).table()
    assert "-63" not in table
    assert max(map(len, table.splitlines())) <= 80


def test_the_longest_names_and_spanish_units_fit_80_columns(fit):
    names = ("drivetrain.dead_zone_backward[0]", *fit.names[1:])
    units = ("N m per unit of u",) * len(names)
    without_value = np.where(np.arange(len(names)) == 1, np.nan, fit.estimate)
    result = replace(fit, names=names, units=units, estimate=without_value)
    with use_language("es"):
        assert max(map(len, result.table().splitlines())) <= 80


def test_parameters_of_single_runs_are_reported(case, case_run):
    fit = identify(case_run(0, 10.0), case, use=("truth",), options=FitOptions(clocks=("truth",)))
    joint_fit = identify(case_run(0, 10.0), case)
    rows = [row for row in fit.run_by_run() if row["name"] == "clock.truth"]
    assert len(rows) == 1
    assert set(rows[0]) == {"run", "name", "estimate", "std"}
    assert json.loads(json.dumps(rows)) == rows
    assert f"clock.truth of {fit.runs[0]}: " in fit.table()
    assert "s, to be added to its timestamps" in fit.table()
    assert "clock." not in joint_fit.table()


def test_intervals_and_correlations_match_the_covariance(fit):
    k = np.flatnonzero(np.isfinite(fit.std))
    C = fit.correlation[np.ix_(k, k)]
    np.testing.assert_allclose(np.diagonal(C), 1.0)
    assert np.linalg.eigvalsh(C)[0] > 0.0
    np.testing.assert_allclose(fit.interval[k, 1] - fit.interval[k, 0], 2.0 * 1.96 * fit.std[k], rtol=1e-4)


def test_each_channel_of_a_fit_contains_data_and_predictions(fit):
    for c in fit.channels:
        residual = c.measurements - c.predictions
        assert np.nanstd(residual) == pytest.approx(c.sigma, rel=0.1)
        assert c.t_s.shape == c.measurements.shape


def test_the_file_receives_values_provenance_and_covariance(fit, case):
    file = fit.updated_file(date(2026, 11, 21))
    np.testing.assert_allclose(file.value("model.friction.linear"), fit.estimate[:3], rtol=1e-3)
    assert file.value("model.actuator_matrix[1,1]") == 1.0  # unobservable: unchanged
    origin = file.provenance["model.friction.linear"]
    assert origin.run == "simulation"
    assert origin.verdict == "USABLE"
    assert np.isnan(file.provenance["model.actuator_matrix"].std[1][1])
    assert file.parameter_cov is not None
    assert len(file.parameter_cov.names) == 12
    assert file.value("sensors.imu.gyro_bias") == pytest.approx(fit.run_entries[0, 2], abs=1e-4)
    fields = dict.fromkeys(name.partition("[")[0] for name in (*fit.names, *fit.run_entry_names[:3]))
    assert list(file.provenance) == list(fields)  # in this order in every process


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"free": ["model.friction.linnear"]}, "parameter.unknown"),
        ({"free": ["model.friction.linear[7]"]}, "parameter.unknown"),
        ({"free": ["model.drivetrain"]}, "parameter.unknown"),
        ({"free": ["model.mass_kg"], "fixed": ["model.mass_kg"]}, "parameter.all-fixed"),
        ({"start": {"model.mass_kg": 2.0}}, "start.not-free"),
        ({"bounds": {"model.friction.linear": (2.0, 1.0)}}, "parameter.bounds"),
        ({"use": ["lidar"]}, "use.unknown"),
        ({"use": ["imu[5]"]}, "use.no-channel"),
        ({"use": ["imu[x]"]}, "use.unreadable"),
        ({"sigma": {"gps": [1.0]}}, "sigma.size"),
        ({"sigma": {"imu": [0.1, 0.1, 0.0]}}, "sigma.negative"),
    ],
)
def test_contradicting_options_of_a_fit_are_refused(case, case_run, options, code):
    arguments = {name: value for name, value in options.items() if name in ("free", "use")}
    fit_options = {name: value for name, value in options.items() if name not in arguments}
    with pytest.raises(UsageError, check=of_code(code)):
        identify(case_run(0, 20.0), case, **arguments, options=FitOptions(**fit_options))


def test_unsuitable_runs_are_refused_with_a_reason(case, case_run):
    run = case_run(0, 20.0)
    imu = run.sensors["imu"]
    cases = {
        "runs.none": [],
        "runs.all-still": replace(run, applied_commands=np.zeros_like(run.applied_commands)),
        "runs.no-command": replace(run, applied_commands=np.full_like(run.applied_commands, np.nan)),
        "use.nothing-common": replace(run, sensors={"gps": imu}),
        "runs.other-size": replace(run, sensors={"imu": imu._replace(z=imu.z[:, :2])}),
        "runs.few-ticks": run.cut(0.0, 0.01),
    }
    for code, runs in cases.items():
        with pytest.raises(UsageError, check=of_code(code)):
            identify(runs, case)
    with pytest.raises(UsageError, check=of_code("truth.absent")):
        identify(replace(run, truth=None), case, use=["truth"])
    without_rows = type(run.truth)(*(column[:0] for column in run.truth))
    with pytest.raises(UsageError, check=of_code("truth.absent", run="cut")):
        identify([run, replace(run, name="cut", truth=without_rows)], case, use=["truth"])
    with pytest.raises(UsageError, check=of_code("runs.no-sensor", sensor="imu")):
        identify([run, replace(run, name="deaf", sensors={})], case, use=["imu"])


def test_a_run_without_readings_among_others_is_refused_by_name(small):
    u = random_steps(small.command.limit, 10.0, 100.0, 0)
    run = simulate(small, u, 0, name="whole")
    imu = run.sensors["imu"]
    no_imu = replace(run, name="empty", sensors={"imu": Channel(imu.t_ns[:0], imu.arrival_ns[:0], imu.z[:0])})
    deaf = replace(run, name="deaf", sensors={})
    with pytest.raises(UsageError, check=of_code("use.read-in-some", runs="empty", sensor="imu")):
        identify([run, no_imu], small)
    with pytest.raises(UsageError, check=of_code("use.not-in-all", runs="empty, deaf")):
        identify([run, no_imu, deaf], small)
    with pytest.raises(UsageError, check=of_code("use.nothing-common", valid="imu")):
        identify(no_imu, small)
    single, joint = (
        identify(runs, small, use=("imu",), options=FitOptions(diagnose=False))
        for runs in (run, [run, no_imu])
    )
    error = np.abs(joint.estimate - single.estimate) / single.std
    assert np.nanmax(error) < 1e-2


@pytest.mark.parametrize(
    "name", ["model.friction.linnear[0]", "model.friction.linear", "model.friction.linear[0"]
)
def test_a_correction_is_proposed_for_a_misspelled_parameter_name(fit, name):
    with pytest.raises(UsageError, check=of_code("fit.not-fitted")) as error:
        fit.value(name)
    assert error.value.diagnostic.figures["suggestion"].figures["match"] == "model.friction.linear[0]"


@pytest.mark.parametrize("name", ["model.mass_kg", "model.friction.coulomb"])
def test_the_value_of_an_unfitted_parameter_advises_to_free_the_parameter(fit, name):
    with pytest.raises(UsageError, check=of_code("fit.not-free")) as error:
        fit.value(name)
    assert error.value.diagnostic.fix == f"--free +{name}"


def test_the_value_of_an_unknown_parameter_is_refused(fit):
    for name in ("model.mas_kg", "nonsense", "model.friction", "model.commands"):
        with pytest.raises(UsageError, check=of_code("fit.not-fitted")):
            fit.value(name)


def test_negative_autocorrelation_is_not_reported_as_floor_disturbance(small):
    """The noise of the gyro was differenced: negative autocorrelation, for which no error bar is widened."""
    run = simulate(small, random_steps(small.command.limit, 20.0, 100.0, 0), 0)
    imu = run.sensors["imu"]
    swing = np.diff(np.random.default_rng(0).normal(0.0, 0.02, len(imu.z) + 1))
    z = imu.z + swing[:, None] * np.array([0.0, 0.0, 1.0])
    fit = identify(
        replace(run, sensors={"imu": imu._replace(z=z)}), small, options=FitOptions(diagnose=False)
    )
    assert not fit.autocorrelated
    assert ("residual.alternates", "imu[2]") in [(note.code, note.subject) for note in fit.notes]
    assert not {"residual.not-white", "cost.try-innovations"} & {note.code for note in fit.notes}


def test_changes_that_a_fit_makes_to_the_data_are_reported(case, case_run):
    run = case_run(0, 20.0)
    imu = run.sensors["imu"]
    z = imu.z.copy()
    z[100:110] = z[99]  # the value is repeated
    keep = np.r_[0:1000, 1030:2000]
    gappy = replace(
        run,
        t_ns=run.t_ns[keep],
        applied_commands=np.where(np.arange(len(keep))[:, None] == 50, np.nan, run.applied_commands[keep]),
        sensors={"imu": Channel(imu.t_ns[keep], imu.arrival_ns[keep], z[keep])},
        truth=None,
    )
    notes = {note.code: note.figures for note in identify(gappy, case).notes}
    assert notes["data.gaps"] == {"gaps": 1, "longest_s": pytest.approx(0.31)}
    dt_s = make_record(gappy, {}).dt_s  # the bounds of a friction are those of a row of one tick
    assert dt_s.max() < 1.5 * np.median(dt_s)
    assert notes["data.repeats"] == {"count": 10, "percent": pytest.approx(0.5, abs=0.05), "longest": 10}
    assert notes["data.command-unknown"] == {"ticks": 1}


def test_samples_at_the_end_of_the_range_are_excluded_from_the_fit(small):
    file = small.with_values({"sensors.imu.gyro_limit": 3.0})
    fit = identify(simulate(file, random_steps(file.command.limit, 20.0, 100.0, 0), 0), file)
    assert "3, -3" in [
        text(reason.figures["ends"]) for reason in fit.reasons if reason.code == "data.clipped"
    ]
    truth = np.array([file.value(name) for name in fit.names])
    z = (fit.estimate - truth) / fit.std
    assert np.nanmax(np.abs(z)) < 5.0


def with_more(run, **sizes: int):
    def channel(m: int) -> Channel:
        return Channel(run.t_ns, run.t_ns, np.zeros((len(run.t_ns), m)))

    return replace(run, sensors=run.sensors | {name: channel(m) for name, m in sizes.items()})


def test_a_sensor_missing_in_the_file_is_reported_with_a_remedy(case_run, case):
    run = with_more(case_run(0, 2.0), odometer=1, rollers=2, battery=1, imu_temperature=1)
    notes = unused_sensors([run, run], case)
    assert len(notes) == 2, "reported once for all runs, without battery and temperature"
    assert [note.code for note in notes] == ["use.not-in-file"] * 2
    assert notes[0].figures == {"sensor": "odometer", "vehicle": "case-study-1", "kind": "odometer"}
    assert notes[1].figures["kind"] == "wheels"
    assert unused_sensors([case_run(0, 2.0)], case) == []


def test_an_unused_sensor_is_reported_unless_the_user_chooses_sensors(
    case_run, tmp_path, monkeypatch, capsys
):
    import pytest

    from baqueano.cli import main
    from baqueano.runs import write_run

    monkeypatch.chdir(tmp_path)
    write_run(with_more(case_run(0, 5.0), odometer=1), tmp_path / "run.mcap")
    texts = []
    for use in ([], ["--use", "imu"]):
        with pytest.raises(SystemExit):
            main(["identify", "run.mcap", "--vehicle", "case-study-1", "--no-noise", *use])
        texts.append("has sensor odometer, which" in capsys.readouterr().err)
    assert texts == [True, False]
    assert load("case-study-1").sensors._fields == ("imu",)
