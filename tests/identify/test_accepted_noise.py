"""Noise is accepted if it is consistent on runs that did not estimate it; otherwise it is estimated again over all
runs."""

import re
from dataclasses import replace

import numpy as np
import pytest

from baqueano.identify import excitation, identify, measure_noise
from baqueano.identify.noise import held_out as accepted_noise
from baqueano.identify.noise.held_out import NormalisedSquare
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.simulate import simulate
from baqueano.simulate.assumed_noise import simulated_errors
from baqueano.vehicle_file import load

SMALL = load("small")
FREE = ["model.friction.linear[0]", "model.friction.linear[2]"]
GYRO, HEADING = ("imu", 2), 2


def drive(seconds_, seed, **truth):
    """Return a run without the truth, so no channel is tested for the speed."""
    u = excitation("random_steps", SMALL.command.limit, seconds_, SMALL.rate_hz, seed=seed)
    return replace(simulate(SMALL.with_values(truth), u, seed), truth=None)


@pytest.fixture(scope="module")
def fit():
    return identify(run := drive(30.0, 1), SMALL, FREE), run


@pytest.fixture(scope="module")
def unseen_run():
    return drive(40.0, 2)


@pytest.fixture(scope="module")
def imu_filter(fit):
    """Return the noise identified from the fitted run."""
    return measure_noise(*fit)


def names_in(figure):
    """Return the names of a list of squares."""
    figures = figure.figures
    return (
        [figures["name"]] if "name" in figures else [n for part in figures.values() for n in names_in(part)]
    )


def variance(noise):
    return noise.in_motion[GYRO[0]][GYRO[1], GYRO[1]]


def test_noise_confirmed_by_an_unseen_run_is_written_unchanged(fit, imu_filter, unseen_run):
    noise = measure_noise(*fit, held_out=[unseen_run])
    assert imu_filter.acceptance is None
    assert noise.acceptance is not None
    assert not noise.acceptance.is_inconsistent
    assert noise.acceptance.message.code == "noise.consistent-in-simulation"
    assert "heading" in names_in(noise.acceptance.message.figures["nees"])
    with use_language("es"):
        assert not re.search(r"[0-9]\.[0-9]", text(noise.acceptance.message))
    assert text(noise.acceptance.message) in noise.table()
    assert variance(noise) == pytest.approx(variance(imu_filter))


def test_noise_contradicted_by_an_unseen_run_is_estimated_again_over_all_runs(fit, imu_filter):
    """The gyro has five times as much noise as in the fitted run."""
    noisy = drive(40.0, 2, **{"sensors.imu.gyro_noise_std": 5.0 * SMALL.sensors.imu.gyro_noise_std})
    noise = measure_noise(*fit, held_out=[noisy])
    assert noise.acceptance is not None
    assert noise.acceptance.message.code in ("noise.estimated-again", "noise.still-inconsistent")
    assert "imu[2]" in names_in(noise.acceptance.message.figures["nis"])
    assert variance(noise) + np.sum(noise.fields["velocity_walk_std"][2] ** 2) > 2.0 * (
        variance(imu_filter) + np.sum(imu_filter.fields["velocity_walk_std"][2] ** 2)
    )
    assert noise.verdict == ("WARN" if noise.acceptance.is_inconsistent else "USABLE")


def test_a_validation_run_of_six_seconds_is_too_short_for_the_noise(fit):
    accepted_noise = measure_noise(*fit, held_out=[drive(6.0, 3)]).acceptance
    assert accepted_noise is not None
    assert accepted_noise.message.code == "noise.too-short"
    assert not accepted_noise.is_inconsistent


def test_noise_is_rejected_if_the_filter_is_overconfident_in_simulation(fit, unseen_run, monkeypatch):
    """The filter claims a ninth of the variance of its heading, which no NIS shows."""

    def surer(ekf, run, filter_result):
        e, P = simulated_errors(ekf, run, filter_result)
        return e, P / np.where(np.arange(6) == HEADING, 9.0, 1.0)[:, None]

    monkeypatch.setattr(accepted_noise, "simulated_errors", surer)
    acceptance = measure_noise(*fit, held_out=[unseen_run]).acceptance
    assert acceptance is not None
    assert acceptance.is_inconsistent
    assert acceptance.message.code == "noise.nees-inconsistent"
    state = acceptance.message.figures["states"]
    assert (state.code, state.figures["states"].figures["name"]) == ("noise.too-small-for", "heading")


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(0.9, 1.1, "true"), (1.1, 1.5, "true"), (1.3, 1.5, "too sure"), (0.5, 0.8, "too cautious"),
     (np.nan, np.nan, "cannot tell")],
)  # fmt: skip
def test_a_normalised_square_disagrees_if_its_interval_is_far_from_one(low, high, verdict):
    square = NormalisedSquare("imu[2]", 1.0, low, high, 1.2)
    assert square.verdict == verdict
    assert square.is_inconsistent == verdict.startswith("too")
