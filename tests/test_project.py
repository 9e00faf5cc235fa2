"""`baqueano new` writes a simulated vehicle that differs from the guessed vehicle file."""

from pathlib import Path

import numpy as np
import pytest

from baqueano.parameter import all_parameters
from baqueano.project.folder import with_other_truth
from baqueano.vehicle_file import load

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.mark.parametrize("name", ["small", "car", EXAMPLES / "servo_axis.toml", EXAMPLES / "omni_robot.toml"])
def test_the_simulated_truth_differs_from_the_guess_in_all_fitted_parameters(name):
    guess = load(name, allow_blocks=True)
    unknown_paths = with_other_truth(guess)
    count = 0
    for path, p in all_parameters(guess.vehicle, "model"):
        x, y = (np.atleast_1d(np.asarray(file.value(path), dtype=float)) for file in (guess, unknown_paths))
        if p.role in ("free", "gain", "term", "reverse"):
            assert np.all((x != y) == (x != 0.0)), path
            assert np.all(np.abs(np.log(y[x != 0.0] / x[x != 0.0])) < 0.6), path
            count += np.count_nonzero(x)
        else:
            np.testing.assert_array_equal(x, y, err_msg=path)
    assert count >= 3
