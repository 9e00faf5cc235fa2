"""A poorly observable bias does not replace a more certain bias of the file."""

import numpy as np
import pytest

from baqueano.identify import FitOptions, excitation, identify
from baqueano.simulate.open_loop import tick_times
from baqueano.study.counterpart import drive_group, run_of_vehicle
from baqueano.study.identification.trials import FLOOR_NOISE, draw_robot, initial_file, quantised_commands

PATH = "sensors.imu.gyro_bias"
SECONDS = 40.0


def fitted(bias=None):
    """Return the default fit of a robot on a rough floor without rests; `bias` is that of its gyro."""
    q = draw_robot(100)
    q = q.with_parameters(floor=np.array([FLOOR_NOISE]))
    if bias is not None:
        q = q.with_parameters(imu=q.imu.with_parameters(bias=np.array([[0.0, 0.0, bias]])))
    file = initial_file(q)
    u = quantised_commands(
        excitation("random_steps", file.command.limit, SECONDS, file.rate_hz, 103, rest_s=0.0)
    )
    motion = drive_group(q, u[:, None], [103], tick_times(len(u), file.rate_hz))
    return identify(
        run_of_vehicle(motion, 0, u, file, "floor", 103), file, options=FitOptions(diagnose=False)
    )


@pytest.fixture(scope="module")
def fit():
    return fitted()


def test_a_gyro_bias_from_the_run_is_less_certain_than_the_file(fit):
    k, imu = fit.run_entry_names.index(PATH), fit.file.sensors.imu
    assert fit.run_entry_sd[0, k] > 5.0 * imu.gyro_bias_std
    assert abs(fit.run_entries[0, k]) > 10.0 * imu.gyro_bias_std


def test_a_more_certain_bias_in_the_file_is_not_replaced(fit):
    fitted_file = fit.vehicle_file
    assert fitted_file.value(PATH) == fit.file.value(PATH)
    assert PATH not in fitted_file.provenance
    assert fitted_file.sensors.imu.gyro_bias_std == fit.file.sensors.imu.gyro_bias_std
    assert ("bias.file-knows-better", PATH) in [(note.code, note.subject) for note in fit.notes]
    assert any(name in fitted_file.provenance for name in ("sensors.imu.accel_bias", "model.friction.linear"))


def test_a_bias_that_contradicts_the_file_is_written_with_its_error():
    fit = fitted(bias=0.35)
    k = fit.run_entry_names.index(PATH)
    fitted_file = fit.vehicle_file
    assert fitted_file.value(PATH) == pytest.approx(fit.run_entries[0, k], rel=1e-4)
    assert fitted_file.sensors.imu.gyro_bias_std == pytest.approx(fit.run_entry_sd[0, k], rel=1e-2)
    assert ("bias.contradicts-file", PATH) in [(note.code, note.subject) for note in fit.notes]
