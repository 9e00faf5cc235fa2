"""A sensor with a constant timestamp offset and lost readings: a fit identifies its clock offset for each run."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import FitOptions, identify, random_steps
from baqueano.simulate import simulate
from baqueano.vehicle_file import load, override, parse

STILL = "model.process_noise_std=[0, 0, 0]"
USUAL = ("model.friction.linear[0]", "model.friction.linear[2]", "model.actuator_matrix[0,0]")
SENSORS = {
    "beacon": "point_m = [2.0, 1.0]\nrate_hz = 10.0\nnoise_std = 0.005",
    "compass": "rate_hz = 20.0\nnoise_std = 0.03",
    "encoders": "count_m = 0.001\nrate_hz = 25.0",
}


def drive_kind(kind, seed):
    """Return the file and a run of 20 s in which the sensor lost a third of its readings."""
    file = override(parse(f"{load('small').text}\n[sensors.{kind}]\n{SENSORS[kind]}\n", "small"), [STILL])
    run = simulate(file, random_steps(file.command.limit, 20.0, file.rate_hz, seed, hold_s=0.5), seed)
    channel = run.sensors[kind]
    rows_kept = np.random.default_rng(seed).random(len(channel.z)) > 1.0 / 3.0
    return file, replace(run, sensors=run.sensors | {kind: type(channel)(*(x[rows_kept] for x in channel))})


@pytest.mark.parametrize(("kind", "late_s"), [("beacon", 0.04), ("compass", -0.025), ("encoders", 0.03)])
def test_the_clock_offset_of_a_slow_sensor_with_lost_readings_is_identified(kind, late_s):
    file, run = drive_kind(kind, 1)
    channel = run.sensors[kind]
    shifted_channel = channel._replace(t_ns=channel.t_ns - round(late_s * 1e9))
    late_run = replace(run, sensors=run.sensors | {kind: shifted_channel})
    fit = identify(
        late_run, file, USUAL, use=("imu", kind), options=FitOptions(clocks=(kind,), diagnose=False)
    )
    clock = fit.run_entry_names.index(f"clock.{kind}")
    assert abs(fit.run_entries[0, clock] - late_s) < 3.5 * fit.run_entry_std[0, clock] < 0.01
