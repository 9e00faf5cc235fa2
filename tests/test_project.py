"""What `baqueano new` puts beside a file of guesses: the vehicle that its simulation drives."""

from pathlib import Path

import numpy as np
import pytest

from baqueano.parameter import all_parameters
from baqueano.project.folder import others_than
from baqueano.vehicle_file import load

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.parametrize("name", ["small", "car", EXAMPLES / "servo_axis.toml", EXAMPLES / "omni_robot.toml"])
def test_a_simulated_vehicle_differs_in_all_that_a_fit_finds_and_in_nothing_that_is_known(name):
    guess = load(name, allow_blocks=True)
    unknown_paths = others_than(guess)
    count = 0
    for path, p in all_parameters(guess.vehicle, "model"):
        x, y = (np.atleast_1d(np.asarray(file.value(path), dtype=float)) for file in (guess, unknown_paths))
        if p.role in ("fitted", "gain", "term"):
            assert np.all((x != y) == (x != 0.0)), path
            assert np.all(np.abs(np.log(y[x != 0.0] / x[x != 0.0])) < 0.6), path
            count += np.count_nonzero(x)
        else:
            np.testing.assert_array_equal(x, y, err_msg=path)
    assert count >= 3
