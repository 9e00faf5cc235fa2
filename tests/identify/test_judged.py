"""A fit is judged by runs that it has not seen."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.errors import UsageError
from baqueano.identify import identify, random_steps
from baqueano.identify.judged import judge
from baqueano.simulate import simulate


def run(file, seed, **changes):
    u = random_steps(file.command.limit, 15.0, file.rate_hz, seed)
    return simulate(file.with_values(changes), u, seed, name=f"run {seed}")


@pytest.fixture(scope="module")
def fit(small):
    return identify(run(small, 1), small)


def test_a_right_model_explains_an_unseen_run_as_well_as_its_own(fit, small):
    found = judge(fit, [run(small, 2), run(small, 3)])
    assert found.verdict == "USABLE"
    assert [f.run for f in found.figures] == ["run 2"] * 3 + ["run 3"] * 3
    noise = {f"imu[{k}]": s for k, s in enumerate(fit.sigma["imu"])}
    for figure in found.figures:
        assert figure.error == pytest.approx(noise[figure.channel], rel=0.15)
        assert figure.explained == pytest.approx(figure.on_own_runs, abs=0.1)


def test_another_vehicle_is_not_explained(fit, small):
    turned = -np.asarray(small.value("model.actuator_matrix"))
    found = judge(fit, run(small, 4, **{"model.actuator_matrix": turned.tolist()}))
    assert found.verdict == "WARN"
    assert "of imu[2] the model explains" in " ".join(found.reasons)
    assert "WARN" in found.table()


def test_a_bias_of_the_unseen_run_is_not_held_against_the_model(fit, small):
    found = judge(fit, run(small, 5, **{"sensors.imu.gyro_bias": 0.1, "sensors.imu.accel_bias": [1.0, -1.0]}))
    assert found.verdict == "USABLE"


def test_errors_on_unseen_runs_have_their_units(fit, small):
    found = judge(fit, run(small, 2))
    assert [f.unit for f in found.figures] == ["m/s²", "m/s²", "rad/s"]
    assert [row["unit"] for row in found.rows()] == ["m/s²", "m/s²", "rad/s"]
    assert "rad/s" in found.table()


def test_a_refused_fit_is_not_judged_by_its_start(fit, small):
    with pytest.raises(UsageError, match="the fit is refused, so there is nothing to judge"):
        judge(replace(fit, verdict="REFUSED"), run(small, 2))


def test_a_run_that_was_fitted_to_cannot_judge(fit, small):
    with pytest.raises(UsageError, match="run 1 was fitted to, so it cannot judge"):
        judge(fit, run(small, 1))
