"""A fit to many runs is told together and drawn in part: the runs of which the model explains least."""

from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import identify
from baqueano.report.of_fit import DRAWN, page_of_fit
from baqueano.simulate import simulate
from baqueano.vehicle_file import load


@pytest.fixture(scope="module")
def many():
    """One fit to 3 s of a car, told as if it were of twelve runs of which each is explained a little less."""
    file = load("car")
    u = np.stack([0.3 + 0.2 * np.sin(0.1 * np.arange(150)), 0.5 * np.cos(0.07 * np.arange(150))], axis=1)
    fit = identify(
        simulate(file, u, 0), file, ["model.throttle_gain", "model.steering_gain"], use=("odometer", "imu[2]")
    )
    names = tuple(f"run-{k:02d}" for k in range(12))
    channels = [
        c._replace(run=name, explained=c.explained - 0.01 * k)
        for k, name in enumerate(names)
        for c in fit.channels
    ]
    return replace(fit, runs=names, channels=tuple(channels))


def test_the_table_has_a_line_per_channel_and_names_the_worst_run(many):
    told = [line for line in many.table().splitlines() if "of 12 runs: noise" in line]
    assert [line.split()[0] for line in told] == ["odometer[0]", "imu[2]"]
    assert all(line.endswith("of run-11") for line in told)


def test_the_page_draws_the_runs_that_are_explained_least(many):
    page = page_of_fit(many)
    drawn = [s.title for s in page.sections if s.title.startswith("Data and model")]
    assert drawn == [f"Data and model: run-{k:02d}" for k in range(12 - DRAWN, 12)]
    assert page.subtitle.startswith("12 runs, run-00 to run-11")
    assert any("Drawn are the 6 runs of 12" in s.text for s in page.sections)
