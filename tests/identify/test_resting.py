"""The bias of a gyro: measured at rest, else that of the file, if the run does not know better."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from baqueano.calibration.rest import with_rest_gyro_bias
from baqueano.identify import FitOptions, excitation, identify, random_steps
from baqueano.simulate import simulate
from baqueano.study.counterpart import drive_runs
from baqueano.study.identification.trials import FLOOR_NOISE, draw_robot, initial_file, quantised_commands
from baqueano.vehicle_file import Provenance, load, override

BIAS = 0.03


def drive_rest(rest_s):
    """Return (file, a run of 20 s of the car whose gyro has BIAS, with the rest at its end)."""
    car = load("car")
    u = np.concatenate([random_steps([0.5, 0.6], 20.0, car.rate_hz, 3), np.zeros((int(50 * rest_s), 2))])
    return car, simulate(override(car, [f"sensors.imu.gyro_bias={BIAS}"]), u, 3)


def test_the_gyro_bias_is_measured_while_the_car_is_at_rest():
    car, run = drive_rest(rest_s=6.0)
    fit = identify(run, car, use=["odometer", "imu[2]"], options=FitOptions(diagnose=False))
    file = fit.vehicle_file
    assert "sensors.imu.gyro_bias" not in fit.run_entry_names
    std = file.provenance["sensors.imu.gyro_bias"].std
    assert abs(file.value("sensors.imu.gyro_bias") - BIAS) < 4.5 * std  # fails once in 150,000 seeds
    assert 0.0 < std < 0.01
    assert fit.notes[0].code == "bias.at-rest"


@pytest.mark.parametrize("period", [1, 3])
def test_each_rest_is_tested_alone_by_its_duration(period):
    """A coast of 0.5 s passed beside a long rest; a rest of 2 s at a third of the rate of the file was too short."""
    car = load("car")
    steps = random_steps([0.5, 0.6], 10.0, car.rate_hz, 3)
    u = np.concatenate([np.zeros((125, 2)), steps, np.zeros((75, 2))])
    run = simulate(override(car, [f"sensors.imu.gyro_bias={BIAS}"]), u, 3)
    channel, std = run.sensors["imu"], float(np.sqrt(car.sensors.imu.cov[-1, -1]))
    z = channel.z.copy()
    z[channel.t_ns > run.t_ns[-1] - 500_000_000, -1] += 3.0 * std
    short = channel._replace(
        t_ns=channel.t_ns[::period], arrival_ns=channel.arrival_ns[::period], z=z[::period]
    )
    file, _ = with_rest_gyro_bias(car, [replace(run, sensors={**run.sensors, "imu": short})])
    std = file.provenance["sensors.imu.gyro_bias"].std
    assert abs(file.value("sensors.imu.gyro_bias") - BIAS) < 4.5 * std


def test_the_scatter_of_the_biases_of_several_runs_is_the_error_of_another_run():
    """Each switch-on has another bias. The mean of three rests is not as accurate as the noise of their readings."""
    car, biases = load("car"), np.array([-0.01, 0.0, 0.01])
    runs = [
        simulate(override(car, [f"sensors.imu.gyro_bias={bias}"]), np.zeros((250, 2)), seed)
        for seed, bias in enumerate(biases)
    ]
    file, _ = with_rest_gyro_bias(car, [replace(run, name=str(k)) for k, run in enumerate(runs)])
    assert file.sensors.imu.gyro_bias_std == pytest.approx(0.01, rel=0.1)
    assert 0.9 < file.provenance["sensors.imu.gyro_bias"].std * np.sqrt(3.0) / 0.01 < 1.3
    single_file, _ = with_rest_gyro_bias(car, runs[:1])
    assert single_file.sensors.imu.gyro_bias_std == car.sensors.imu.gyro_bias_std


def test_without_a_rest_the_gyro_bias_of_the_file_is_used():
    car, run = drive_rest(rest_s=0.0)
    fit = identify(run, car, use=["odometer", "imu[2]"], options=FitOptions(diagnose=False))
    assert fit.vehicle_file.value("sensors.imu.gyro_bias") == car.value("sensors.imu.gyro_bias")
    assert fit.notes[0].code == "bias.no-rest"
    path = "sensors.imu.gyro_bias"
    measured_car = car.with_values(
        {path: BIAS}, {path: Provenance("a rest", date(2026, 1, 1), 1e-3, "USABLE")}
    )
    fit = identify(run, measured_car, use=["odometer", "imu[2]"], options=FitOptions(diagnose=False))
    assert not {"bias.no-rest", "bias.at-rest"} & {note.code for note in fit.notes}


def offset(car, run, zero, std):
    """Return estimate and standard error of the steering offset, with a gyro bias that is measured ± std or
    unmeasured."""
    path = "sensors.imu.gyro_bias"
    provenance = {} if std is None else {path: Provenance("a rest", date(2026, 1, 1), std, "USABLE")}
    fit = identify(run, car.with_values({path: zero}, provenance), use=["odometer", "imu[2]"])
    k = fit.names.index("model.steering_offset_rad")
    return fit.estimate[k], fit.std[k]


def test_the_steering_error_includes_the_gyro_bias_error():
    """A gyro bias has the effect of a steering offset; an unmeasured bias contributes what the run can identify."""
    car, run = drive_rest(rest_s=0.0)
    estimate, precise = offset(car, run, BIAS, 1e-9)
    _, unsure = offset(car, run, BIAS, 0.01)
    shift = offset(car, run, BIAS + 0.001, 1e-9)[0] - estimate
    assert np.sqrt(unsure**2 - precise**2) / 0.01 == pytest.approx(abs(shift) / 0.001, rel=0.05)
    assert 1.01 * precise < offset(car, run, BIAS, None)[1] < unsure


def test_a_car_turned_by_hand_is_not_at_rest():
    car, run = drive_rest(rest_s=6.0)
    imu = run.sensors["imu"]
    turned_z = (
        imu.z + np.where(imu.t_ns > run.t_ns[-250], 1.0, 0.0)[:, None] * np.sin(imu.t_ns * 3e-9)[:, None]
    )
    run = replace(run, sensors={**run.sensors, "imu": imu._replace(z=turned_z)})
    fit = identify(run, car, use=["odometer", "imu[2]"], options=FitOptions(diagnose=False))
    assert fit.vehicle_file.value("sensors.imu.gyro_bias") == car.value("sensors.imu.gyro_bias")


def test_a_free_delay_may_exceed_its_value_in_the_file():
    car = load("car")
    u = random_steps([0.5, 0.6], 40.0, car.rate_hz, 5)
    run = simulate(override(car, ["model.drivetrain.delay_s=0.13"]), u, 5)
    free = ["model.throttle_gain", "model.yaw_lag_s", "model.drivetrain.delay_s"]
    fit = identify(run, car, free, use=["odometer", "imu[2]"], options=FitOptions(diagnose=False))
    assert fit.value("model.drivetrain.delay_s") == pytest.approx(0.13, abs=0.004)


PATH = "sensors.imu.gyro_bias"
SECONDS = 40.0


STATED = {f"{PATH}_std": 0.002}


def fitted(bias=None, rest_s=0.0, values=STATED):
    """Return the default fit of a robot on a rough floor; `bias` is that of its gyro, `values` those of the file."""
    q = draw_robot(100)
    q = q.with_parameters(floor=np.array([FLOOR_NOISE]))
    if bias is not None:
        q = q.with_parameters(imu=q.imu.with_parameters(bias=np.array([[0.0, 0.0, bias]])))
    file = initial_file(q).with_values(values)
    u = quantised_commands(
        excitation("random_steps", file.command.limit, SECONDS, file.rate_hz, 103, rest_s=rest_s)
    )
    return identify(drive_runs([q], [u], [103], [file]), file, options=FitOptions(diagnose=False))


@pytest.fixture(scope="module")
def fit():
    return fitted()


def test_a_gyro_bias_from_the_run_is_less_certain_than_the_file(fit):
    k, imu = fit.run_entry_names.index(PATH), fit.file.sensors.imu
    assert fit.run_entry_std[0, k] > 5.0 * imu.gyro_bias_std
    assert abs(fit.run_entries[0, k]) > 10.0 * imu.gyro_bias_std


def test_a_more_certain_bias_in_the_file_is_not_replaced(fit):
    fitted_file = fit.vehicle_file
    assert fitted_file.value(PATH) == fit.file.value(PATH)
    assert PATH not in fitted_file.provenance
    assert fitted_file.sensors.imu.gyro_bias_std == fit.file.sensors.imu.gyro_bias_std
    assert ("bias.file-better", PATH) in [(note.code, note.subject) for note in fit.notes]
    assert any(name in fitted_file.provenance for name in ("sensors.imu.accel_bias", "model.friction.linear"))


def test_a_bias_that_the_file_does_not_state_is_written_with_the_error_of_the_drive():
    fit = fitted(values={})
    k = fit.run_entry_names.index(PATH)
    assert fit.vehicle_file.value(PATH) == pytest.approx(fit.run_entries[0, k], rel=1e-4)
    assert fit.vehicle_file.sensors.imu.gyro_bias_std == pytest.approx(fit.run_entry_std[0, k], rel=1e-2)


def test_a_car_without_a_rest_keeps_its_bias_and_gets_the_error_of_the_fit():
    car = override(load("car"), ["sensors.imu.gyro_bias=0.0"])
    run = simulate(
        override(car, ["sensors.imu.gyro_bias=0.03"]), random_steps([0.5, 0.6], 40.0, car.rate_hz, 5), 5
    )
    free = ["model.throttle_gain", "model.steering_gain", "model.steering_offset_rad"]
    fit = identify(run, car, free, use=["odometer", "imu[2]"], options=FitOptions(diagnose=False))
    assert fit.vehicle_file.value(PATH) == 0.0
    assert 0.02 < fit.vehicle_file.sensors.imu.gyro_bias_std < 0.06


def test_a_bias_that_contradicts_the_file_is_written_with_its_error():
    fit = fitted(bias=0.35)
    k = fit.run_entry_names.index(PATH)
    fitted_file = fit.vehicle_file
    assert fitted_file.value(PATH) == pytest.approx(fit.run_entries[0, k], rel=1e-4)
    assert fitted_file.sensors.imu.gyro_bias_std == pytest.approx(fit.run_entry_std[0, k], rel=1e-2)
    assert ("bias.contradicts-file", PATH) in [(note.code, note.subject) for note in fit.notes]


def test_a_bias_measured_at_rest_replaces_that_of_a_drive_on_a_rough_floor():
    fit = fitted(bias=0.03, rest_s=3.0)
    fitted_file = fit.vehicle_file
    assert fitted_file.value(PATH) == pytest.approx(0.03, abs=0.002)
    assert fitted_file.provenance[PATH].std < 0.1 * fit.run_entry_std[0, fit.run_entry_names.index(PATH)]
    assert fitted_file.sensors.imu.gyro_bias_std == fit.file.sensors.imu.gyro_bias_std
    assert not {"bias.file-better", "bias.contradicts-file"} & {note.code for note in fit.notes}
