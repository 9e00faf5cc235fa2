"""The effect of the errors of a fit on a drive, tested with vehicles drawn from its covariance.

The spread of 600 drawn vehicles is known to 3 %; a deviation of 15 % from the forecast is a false alarm below 1e-5.
The forecast is linear in the errors; the drawn vehicles are not.
"""

import json
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

from baqueano.calibration.tolerances import with_tolerance
from baqueano.cli import main
from baqueano.diagnostics import note
from baqueano.errors import UsageError
from baqueano.guides.shapes import eight
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.parameters.free import value
from baqueano.numerics.normal_equations import mean_square_error
from baqueano.report.fit_report import fit_page
from baqueano.runs import write_run
from baqueano.simulate import simulate
from baqueano.simulate.many import simulate_many
from baqueano.validation.forecast import MAX_HEADING_STD_RAD, DriveForecast, _lap, forecast
from baqueano.vehicle_file import Provenance, load, parse
from tests.codes import of_code
from tests.identify.test_speed_error import no_fixed_parameters
from tests.identify.test_strangers_wheels import FILE, TRACK_M, drive as drive_with_counts
from tests.identify.test_voltage import EFFECT, emptied

WITH_DEAD_ZONES = FILE.replace(
    "[sensors.wheels]",
    "dead_zone_forward = [0.05, 0.05]\ndead_zone_backward = [0.05, 0.05]\n[sensors.wheels]",
)
LIMIT = {"small": [1.0, 0.0, 1.0], "car": [0.5, 0.8]}


def drive_named(name, seconds=40.0, seed=1):
    file = load(name)
    run = simulate(file, random_steps(LIMIT[name], seconds, file.rate_hz, seed), seed)
    return file, run


def fitted(name):
    file, run = drive_named(name)
    # otherwise at its bound, which half of the draws reach
    fixed_names = ["model.quadratic_drag"] if name == "car" else []
    return identify(run, file, options=FitOptions(fixed=fixed_names, diagnose=False)), run


@pytest.fixture(scope="module")
def small():
    return fitted("small")


@pytest.fixture(scope="module")
def car():
    return fitted("car")


@pytest.fixture(params=["small", "car"])
def fit_and_run(request):
    return request.getfixturevalue(request.param)


def spread(fit, u):
    """Return the root mean square of position and heading at the end of 600 drawn vehicles around the fitted
    vehicle."""
    group, single = simulate_many(fit.vehicle_file, u, 600), simulate_many(fit.vehicle_file, u, 1, vary={})
    error = group.eta[:, -1] - single.eta[:, -1]
    return np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2)), np.sqrt(np.mean(error[:, 2] ** 2))


def path_of(file, u):
    """Return the poses (N, 3) without process noise."""
    return simulate(file.with_values({"model.process_noise_std": [0.0, 0.0, 0.0]}), u).truth.eta


def rms_of_ten_seconds(paths):
    """Return the root mean square difference of the changes of heading in 10 s, once per second."""
    change = np.unwrap(paths[1][:, 2]) - np.unwrap(paths[0][:, 2])
    return np.sqrt(np.mean((change[1000::100] - change[:-1000:100]) ** 2))


def exact_scales(fit):
    """Return the fit without the errors of fixed parameters, which drawn vehicles do not have."""
    return replace(fit, fixed=no_fixed_parameters(len(fit.names)))


def test_the_forecast_error_over_ten_seconds_matches_drawn_vehicles(fit_and_run):
    fit, _ = fit_and_run
    rate = fit.file.rate_hz
    short = simulate(fit.file, random_steps(LIMIT[fit.file.name], 10.1, rate, 5), 5, name="short")
    (drive, *_) = forecast(exact_scales(fit), short).drives
    position, heading = spread(fit, short.applied_commands[: round((drive.duration_s + 1.0 / rate) * rate)])
    assert drive.duration_s == pytest.approx(10.0)
    assert drive.position_m == pytest.approx(position, rel=0.15)
    assert drive.heading_rad == pytest.approx(heading, rel=0.15)


def test_the_forecast_error_over_a_lap_matches_drawn_vehicles(fit_and_run):
    fit, run = fit_and_run
    route = eight(1.0, 0.25)
    lap = forecast(exact_scales(replace(fit, channels=())), run, route, "lab").drives[
        1
    ]  # without the misfit by the floor
    paths = tuple(
        n for n, std in zip(fit.names, fit.std, strict=True) if n.startswith("model.") and std > 0.0
    )
    (_, u), _ = _lap(fit, paths, np.array([value(fit.blocks, path) for path in paths]), route)
    position, heading = spread(fit, u)
    assert lap.message.code == "forecast.error"
    assert lap.drive == note("forecast.lap-of", name="lab")
    assert lap.distance_m == pytest.approx(6.1, rel=0.05)
    assert lap.position_m == pytest.approx(position, rel=0.15)
    assert lap.heading_rad == pytest.approx(heading, rel=0.15)


def test_the_forecast_of_an_incomplete_model_agrees_with_unseen_drives():
    """The fit has dead zones in place of the dry friction of the wheels. Its error bars contain their difference."""
    run = drive_with_counts(1)
    fit = exact_scales(identify(run, parse(WITH_DEAD_ZONES, "stranger.toml")))
    exact, errors = fit.vehicle_file.with_values({"model.process_noise_std": [0.0, 0.0, 0.0]}), []
    for seed in (3, 4, 5):
        unseen = drive_with_counts(seed)
        turn = np.diff(unseen.sensors["wheels"].z, axis=1)[:, 0] / TRACK_M / 50.0
        psi = np.unwrap(simulate(exact, unseen.applied_commands).truth.eta[:, 2])
        error = np.cumsum(turn) - psi[1:]
        errors.append(error[500:] - error[:-500])
    (drive, *_) = forecast(fit, run).drives
    actual = float(np.sqrt(np.mean(np.square(errors))))
    assert 0.67 < drive.heading_rad / actual < 1.5
    exact_fit = replace(fit, cov=fit.unmodelled_cov)  # without the errors of the parameters
    of_misfit, of_parameters = (
        forecast(f, run).drives[0].heading_rad for f in (exact_fit, replace(fit, channels=()))
    )
    assert drive.heading_rad**2 == pytest.approx(of_misfit**2 + 2.0 * of_parameters**2)  # Akaike 1970
    fit_with_larger_cov = replace(fit, cov=4.0 * fit.cov, unmodelled_cov=fit.unmodelled_cov + 3.0 * fit.cov)
    assert forecast(fit_with_larger_cov, run).drives[0].heading_rad == pytest.approx(drive.heading_rad)


def test_the_forecast_contains_the_unmeasured_scale_of_a_gyro(small):
    """A gyro that reads 1 % too much moves the fit. With a tolerance of σ = 1 %, the forecast is that change."""
    fit, run = small
    imu = run.sensors["imu"]
    damaged_run = replace(run, sensors={**run.sensors, "imu": imu._replace(z=imu.z * [1.0, 1.0, 1.01])})
    fit_2, u = identify(damaged_run, fit.file, options=FitOptions(diagnose=False)), run.applied_commands
    etas = [path_of(f.vehicle_file, u) for f in (fit, fit_2)]
    scales = {"sensors.imu.gyro_scale": 0.01 * np.sqrt(3.0), "sensors.imu.accel_scale": 0.0}
    diagnosed_fit = identify(run, with_tolerance(fit.file, scales))
    fixed_values = diagnosed_fit.fixed._replace(
        cov=np.array([[0.01**2]])
    )  # without the information of the run
    exact = replace(diagnosed_fit, cov=diagnosed_fit.unmodelled_cov, channels=(), fixed=fixed_values)
    prediction, heading = forecast(exact, run), rms_of_ten_seconds(etas)
    assert prediction.drives[0].heading_rad == pytest.approx(heading, rel=0.1)
    assert [message.code for message in prediction.notes if "scales" in message.code] == ["forecast.scales"]


def with_wheels(keys):
    """Return `small` with encoders of the given keys, and its run."""
    text = (files("baqueano.garage") / "small.toml").read_text(encoding="utf-8")
    file = parse(f'{text}\n[sensors.wheels]\nkind = "wheels"\nnoise_std = 0.01\n{keys}', "small.toml")
    return file, simulate(file, random_steps(LIMIT["small"], 40.0, file.rate_hz, 1), 1)


def test_the_forecast_contains_the_declared_error_of_a_track():
    """The wheels alone do not show their distance: a track 1 % wider is a vehicle that turns 1 % slower."""
    file, run = with_wheels("radius_scale_std = 0.0")
    track, error_m = "sensors.wheels.track_m", 0.0012
    measured_file = file.with_values({track: 0.12}, {track: Provenance("tape", None, error_m)})
    wider = file.with_values({track: 0.12 + error_m})
    fit, fit_of_wider = (identify(run, f, use=["wheels"]) for f in (measured_file, wider))
    assert fit.fixed.paths == (track,)
    fixed_values = fit.fixed._replace(cov=np.array([[error_m**2]]))  # without the information of the run
    prediction = forecast(replace(fit, cov=fit.unmodelled_cov, channels=(), fixed=fixed_values), run)
    heading = rms_of_ten_seconds([path_of(f.vehicle_file, run.applied_commands) for f in (fit, fit_of_wider)])
    assert prediction.drives[0].heading_rad == pytest.approx(heading, rel=0.1)
    assert ("forecast.fixed", track) in [(message.code, message.subject) for message in prediction.notes]


def test_sensors_that_measure_the_same_turns_show_the_scale_of_a_gyro():
    """The file states a scale within ± 1.5 %. The wheels show that it reads 1 % too much, as a fit with a free scale
    does."""
    file, run = with_wheels("radius_scale_std = 0.0")
    imu = run.sensors["imu"]
    run = replace(run, sensors={**run.sensors, "imu": imu._replace(z=imu.z * [1.0, 1.0, 1.01])})
    fit, free = identify(run, file), identify(run, file, ["+sensors.imu.gyro_scale"])
    k, j = (x.index("sensors.imu.gyro_scale") for x in (free.names, fit.fixed.paths))
    error = np.hypot(free.estimate[k] - 1.0, free.std[k])
    assert 0.005 < error < 0.015
    assert np.sqrt(fit.fixed.cov[j, j]) == pytest.approx(error, rel=0.1)


def test_runs_that_contradict_the_vehicle_file_do_not_change_its_errors():
    small_N, large_g = 4.0 * np.eye(1), np.array([400.0])
    assert mean_square_error(np.eye(1), small_N, small_N, large_g) == pytest.approx(np.eye(1))
    assert mean_square_error(np.eye(1), small_N, small_N, np.zeros(1)) == pytest.approx(0.2 * np.eye(1))


def test_the_forecast_states_the_speed_with_an_empty_battery():
    """Without friction at low speed, the speed of `small` with half of its voltage is below half of its speed."""
    file, run = drive_named("small", 20.0)
    file = file.with_values({"robot.least_battery_v": 3.7})
    notes = forecast(identify(run, file, options=FitOptions(diagnose=False)), run).notes
    (message,) = [message for message in notes if message.code == "forecast.battery"]
    assert (message.figures["low_v"], message.figures["full_v"]) == (3.7, 7.4)
    assert 50.0 < message.figures["percent"] < 100.0


def test_the_forecast_contains_the_error_of_the_battery_effect():
    small = load("small").with_values({"model.drivetrain.limit": [np.inf]})
    run = emptied(small, 1.0, 1)
    volts = np.linspace(7.8, 6.8, len(run.t_ns))
    fit = exact_scales(identify(run, small, ["model.actuator_matrix[0,0]", EFFECT]))
    k = fit.names.index(EFFECT)
    only = np.zeros_like(fit.cov)
    only[k, k] = fit.cov[k, k]
    of_effect = forecast(replace(fit, cov=only, unmodelled_cov=0.0 * only, channels=()), run).drives[0]
    scale = 1.0 + (fit.estimate[k] + np.array([0.0, fit.std[k]])) * (volts[:, None] / 7.4 - 1.0)
    steady = fit.vehicle_file.with_values(
        {"model.drivetrain.battery": "steady", "model.drivetrain.battery_v": 7.4}
    )
    paths = [path_of(steady, run.applied_commands * s[:, None]) for s in scale.T]
    heading = rms_of_ten_seconds(paths)
    assert of_effect.heading_rad == pytest.approx(heading, rel=0.2)


def test_runs_with_equal_names_have_their_own_residuals():
    runs = [drive_with_counts(seed) for seed in (1, 3)]
    named_runs = [replace(run, name="a run") for run in runs]
    first, named_drive = (
        forecast(identify(r, parse(FILE, "stranger.toml")), r).drives[0] for r in (runs, named_runs)
    )
    assert named_drive.heading_rad == pytest.approx(first.heading_rad)


def test_a_forecast_skips_the_pauses_of_a_log(small):
    """In a pause the commands are unknown."""
    fit, run = replace(small[0], channels=()), small[1]
    delays = np.where(np.arange(len(run.t_ns)) < len(run.t_ns) // 2, 0, 400_000_000_000)
    (drive, *_), (paused_drive, *_) = (
        forecast(fit, r).drives for r in (run, replace(run, t_ns=run.t_ns + delays))
    )
    assert paused_drive.distance_m == pytest.approx(drive.distance_m, rel=0.2)
    assert paused_drive.heading_rad == pytest.approx(drive.heading_rad, rel=0.2)


def test_a_forecast_that_cannot_cover_a_lap_reports_its_reason(small):
    fit, run = small
    result = forecast(exact_scales(fit), run, eight(0.5, 30.0))
    assert len(result.drives) == 1
    assert result.notes[0].code == "forecast.strays"


def test_a_lost_heading_gives_no_distance_forecast():
    message = DriveForecast(note("forecast.lap"), 60.0, 12.0, 3.0, MAX_HEADING_STD_RAD + 0.1).message
    assert (message.code, message.figures["heading_deg"]) == ("forecast.lost", "34")


def test_a_fit_by_innovations_has_a_forecast():
    """Its parameters also contain the process noise, which has no effect on the path."""
    file, run = drive_named("small", 20.0)
    options = FitOptions(cost="innovations", diagnose=False)
    fit = identify(run, file, ["model.actuator_matrix[0,0]", "model.friction.linear[0]"], options=options)
    assert fit.fixed.shifts.shape[1] == len(fit.names) > 2
    assert 0.0 < forecast(fit, run).drives[0].position_m < 0.1


def test_a_fit_of_only_sensor_parameters_gives_no_forecast():
    file, run = drive_named("small", 10.0)
    fit = identify(run, file, ["sensors.imu.lever_arm_m"], options=FitOptions(diagnose=False))
    with pytest.raises(UsageError, check=of_code("forecast.no-errors")):
        forecast(fit, run)


def test_commands_beyond_the_envelope_of_the_fit_are_reported(small):
    fit, run = small
    narrow = fit.envelope._replace(low=0.5 * fit.envelope.low, high=0.5 * fit.envelope.high)
    notes = forecast(replace(fit, envelope=narrow), run, eight(1.0, 0.4)).notes
    assert ("envelope.left", "u_x") in [(note.code, note.subject) for note in notes]


def test_terminal_json_and_report_show_the_forecast(small, tmp_path, monkeypatch, capsys):
    fit, run = small
    monkeypatch.chdir(tmp_path)
    fit.file.save(tmp_path / "vehicle.toml")
    write_run(run.cut(0.0, 10.0), tmp_path / "one.mcap")
    words = ["identify", "one.mcap", "--no-noise", "--route", "circle", "--free", "model.mass_kg"]
    with pytest.raises(SystemExit):
        main(words)
    output = capsys.readouterr().out
    assert "s of open loop, driven like these runs (" in output
    assert "s of open loop, one lap of circle (" in output
    with pytest.raises(SystemExit):
        main([*words, "--json"])
    rows = json.loads(capsys.readouterr().out)["forecast"]
    assert [row["drive"] for row in rows] == ["driven like these runs", "one lap of circle"]
    assert 0.0 < rows[0]["position_m"] < 0.5
    page = fit_page(fit, drive_forecast=forecast(fit, run))
    assert [section for section in page.sections if section.title == "Consequences for a drive"]


def test_wheels_that_agree_with_the_model_do_not_hide_an_error_of_the_yaw_rate():
    """The model lacks a yaw rate a sin(2π t/T), T = 20 s, which a gyro measures; wheels that slip do not."""
    with_wheels = f'[sensors.wheels]\nkind = "wheels"\ntrack_m = {TRACK_M}\nnoise_std = 0.01\n\n[estimator]'
    text = (files("baqueano") / "garage" / "small.toml").read_text(encoding="utf-8")
    file = parse(text.replace("[estimator]", with_wheels, 1), "wheels.toml")
    run = simulate(file, random_steps(LIMIT["small"], 60.0, file.rate_hz, 1), 1)
    free = ["model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]"]
    fit = identify(run, file, free, use=["wheels", "imu[2]"], options=FitOptions(diagnose=False))
    amplitude, period_s = 0.1, 20.0
    channels = tuple(
        c._replace(
            predictions=c.predictions - amplitude * np.sin(2.0 * np.pi / period_s * c.t_s),
            sigma=amplitude / np.sqrt(2.0),
        )
        if c.label == "imu[2]"
        else c
        for c in fit.channels
    )
    prediction = forecast(replace(fit, channels=channels, autocorrelated=True), run).drives[0]
    assert prediction.duration_s == period_s / 2.0
    # after half a period the heading has changed by (a T / π) cos φ
    assert prediction.heading_rad == pytest.approx(amplitude * period_s / np.pi / np.sqrt(2.0), rel=0.1)
