"""What a log tells of the noise of the recommended filter: of a mark that is seldom passed less than of a gyro."""

import pytest

from baqueano.identify.noise.filter_noise import FEWEST, SOME, _free
from baqueano.vehicle_file import load, parse

TAGS = '\n[sensors.tags]\nkind = "tags"\npoints_m = [[0.5, 0.0], [-0.5, 0.0]]\n'
FORWARD = ["disturbance_std[0]", "disturbance_fade_s[0]", "velocity_walk_std[0]"]
NOISE = [f"sensors.tags.measurement_noise_cov[{i},{i}]" for i in (0, 1)]


@pytest.mark.parametrize(
    ("tags", "free"), [(0, []), (SOME, FORWARD[:1]), (FEWEST - 1, FORWARD[:1]), (FEWEST, [*FORWARD, *NOISE])]
)
def test_few_readings_tell_the_size_of_a_misfit_and_nothing_of_their_own_noise(tags, free):
    ekf = parse(load("small").text + TAGS, "small").estimator(use=("imu", "tags"))
    found = {one.path for one in _free(ekf, {"imu"}, {}, {"imu": 6000, "tags": tags})}
    assert {path for path in found if "[1]" not in path and "[2]" not in path} == set(free)
    assert {"disturbance_std[1]", "disturbance_fade_s[1]", "velocity_walk_std[2]"} <= found
