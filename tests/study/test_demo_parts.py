"""The parts of the demo that need no drive: the guessed vehicle, and the table of truth and estimate."""

import numpy as np
import pytest

from baqueano.project.folder import first_guess
from baqueano.study.demo import GUESSED_VALUES, Demo
from baqueano.vehicle_file import load


class FitResult:
    """The attributes of a fit that the table of the demo uses."""

    def __init__(self, names, estimate, std):
        self.names, self.verdict, self.reasons = names, "USABLE", ("converged",)
        self.estimate, self.std = np.array(estimate), np.array(std)

    def rows(self):
        return [
            {"name": n, "estimate": None if np.isnan(e) else e, "std": None if np.isnan(e) else s}
            for n, e, s in zip(self.names, self.estimate, self.std, strict=True)
        ]


def demo_of(names, estimate, std) -> Demo:
    demo = object.__new__(Demo)
    object.__setattr__(demo, "truth", load("small"))
    object.__setattr__(demo, "fit", FitResult(names, estimate, std))
    return demo


def test_the_guessed_vehicle_differs_from_the_true_vehicle():
    truth = load("small")
    guess = truth.with_values(GUESSED_VALUES)
    project = first_guess("small")
    for key in GUESSED_VALUES:
        np.testing.assert_array_equal(project.value(key), guess.value(key), err_msg=f"{key} of a new project")
        assert not np.array_equal(guess.value(key), truth.value(key)), (
            f"{key}: the demo would know the answer"
        )


def test_the_true_actuator_gain_includes_the_mean_gain_of_unequal_wheels():
    truth = load("small")
    gain = truth.vehicle.drivetrain.gain
    demo = demo_of(("model.actuator_matrix[0,0]", "model.friction.linear[0]"), [1.0, 1.0], [1.0, 1.0])
    assert demo.true_values == pytest.approx([3.38 * np.mean(gain), 3.3])


def test_each_row_contains_the_normalised_error_of_an_estimate():
    names = ("model.friction.linear[0]", "model.friction.linear[1]", "model.friction.linear[2]")
    rows = demo_of(names, [3.4, np.nan, 1.0], [0.1, 1.0, 0.001]).rows()
    assert rows[0]["z"] == pytest.approx(1.0)
    assert [row["verdict"] for row in rows] == ["ok", "not identifiable", "inconsistent"]
    assert [row["truth"] for row in rows] == pytest.approx([3.3, 40.0, 0.0115])
