"""The noise parameters of the recommended filter that a log can identify: fewer for a rare mark than for a gyro."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.estimators.augmented.state import layout
from baqueano.identify.noise.filter_noise import MIN_READINGS, MIN_RESIDUALS, _free_noise, _rounding
from baqueano.vehicle_file import load, parse

TAGS = '\n[sensors.tags]\nkind = "tags"\npoints_m = [[0.5, 0.0], [-0.5, 0.0]]\n'
FORWARD = ["disturbance_std[0]", "disturbance_fade_s[0]", "velocity_walk_std[0]"]
NOISE = [f"sensors.tags.measurement_noise_cov[{i},{i}]" for i in (0, 1)]


@pytest.mark.parametrize(
    ("tags", "free"),
    [
        (0, []),
        (MIN_READINGS, FORWARD[:1]),
        (MIN_RESIDUALS - 1, FORWARD[:1]),
        (MIN_RESIDUALS, [*FORWARD, *NOISE]),
    ],
)
def test_few_readings_identify_the_misfit_but_not_the_sensor_noise(tags, free):
    ekf = parse(load("small").text + TAGS, "small").estimator(use=("imu", "tags"))
    paths = {parameter.path for parameter in _free_noise(ekf, {"imu"}, {}, {"imu": 6000, "tags": tags})}
    assert {path for path in paths if "[1]" not in path and "[2]" not in path} == set(free)
    assert {"disturbance_std[1]", "disturbance_fade_s[1]", "velocity_walk_std[2]"} <= paths


def test_the_noise_of_a_counted_speed_is_at_least_its_step():
    """Readings that never repeat do not show a step. A tag, which repeats its position, is not treated as counted."""
    text = load("small").text + TAGS + '\n[sensors.odometer]\nkind = "odometer"\n'
    its = layout(parse(text, "small").estimator(use=("imu", "odometer", "tags")))
    rng = np.random.default_rng(3)
    speed, tags = rng.uniform(0.0, 1.0, (600, 1)), 0.5 * rng.choice([-1.0, 1.0], (600, 2))
    imu = 0.01 * np.rint(100.0 * rng.standard_normal((600, 3)))

    def rounding_of(z):
        run = SimpleNamespace(
            sensors={n: SimpleNamespace(z=x) for n, x in zip(its.names, (imu, z, tags), strict=True)}
        )
        return _rounding(its, {"imu"}, [run])

    assert rounding_of(0.04 * np.rint(speed / 0.04)) == {
        ("odometer", 0): (pytest.approx(0.04**2 / 12.0), np.inf)
    }
    assert rounding_of(speed) == {}
