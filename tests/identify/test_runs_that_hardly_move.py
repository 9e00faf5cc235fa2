"""A verdict over many runs: the weight of each run depends on its amount of motion."""

import numpy as np
import pytest

from baqueano.diagnostics import Severity, note
from baqueano.identify import identify
from baqueano.identify.result import verdict as verdicts
from baqueano.identify.result.fit_result import ChannelFit
from baqueano.identify.result.verdict import Evidence, fit_verdict, group_channels, remarks
from baqueano.numerics.statistics import explained_variance
from baqueano.runs.run import Channel, Run
from baqueano.vehicle_file import parse

CART = """
format = 1
name = "cart"
rate_hz = 10.0
[command]
names = ["u_x", "u_y", "u_psi"]
unit = "V"
limit = [12.0, 0.0, 0.0]
[model]
kind = "kinematic"
velocity_matrix = [[0.05, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
[sensors.odometer]
kind = "odometer"
"""

T_S = np.arange(400) / 100.0
NOISE = 0.01


def step(k, speed, speed_model):
    """Return a step to `speed` for which the model predicts `speed_model` [m/s]."""
    on = (T_S > 0.5) & (T_S < 2.5)
    z = speed * on + np.random.default_rng(k).normal(0.0, NOISE, len(T_S))
    part = explained_variance(z, speed_model * on, 0.05)
    return ChannelFit(f"step {k}", "odometer", 0, T_S, z, speed_model * on, 0.05, part, 0.0)


def evidence(channels):
    unit, runs = np.ones(1), group_channels(channels, None)
    return Evidence(("gain",), unit, 0 * unit, 0 * unit, 0, (), channels, runs, True, np.zeros(1), None)


def test_runs_inside_the_dead_zone_are_named_but_the_fit_is_usable():
    runs = [step(k, 0.1 * (k + 3), 0.1 * (k + 3) + 0.04 * (-1) ** k) for k in range(26)]
    runs += [step(26, 0.0, 0.08), step(27, 0.0, 0.08)]
    assert np.mean([c.explained_fraction for c in runs]) < -1.0
    e = evidence(runs)
    assert fit_verdict(e)[0] == "USABLE"
    (message,) = [reason for reason in remarks(e) if reason.code == "runs.little-motion"]
    assert message.figures == {"count": 2, "total": 28, "runs": "step 26, step 27"}


def test_a_moving_run_that_contradicts_the_model_gives_a_warning():
    e = evidence([step(k, 0.5, 0.5) for k in range(6)] + [step(6, 0.5, -0.5)])
    verdict, reasons = fit_verdict(e)
    assert verdict == "WARN"
    (message,) = [reason for reason in reasons if reason.code == "runs.unlike-model"]
    assert message.figures == {"count": 1, "total": 7, "runs": "step 6"}


def test_an_unknown_speed_is_reported_beside_the_other_warnings():
    unknown = note("fit.speed-unknown", Severity.WARNING, names="model.friction.linear[0]")
    e = evidence([step(k, 0.5, 0.5) for k in range(6)] + [step(6, 0.5, -0.5)])
    verdict, reasons = fit_verdict(e._replace(speed_warnings=(unknown,)))
    assert verdict == "WARN"
    assert {"runs.unlike-model", "fit.speed-unknown"} <= {reason.code for reason in reasons}


@pytest.mark.parametrize(
    ("autocorrelation", "cause"), [(0.1, "fit.little-motion"), (0.9, "fit.incomplete-model")]
)
def test_a_fit_with_wide_errors_names_motion_or_model_as_the_cause(autocorrelation, cause):
    e = evidence([step(k, 0.5, 0.4) for k in range(3)])
    e = e._replace(poorly_identified=np.ones(1), autocorrelation=np.full(1, autocorrelation))
    verdict, reasons = fit_verdict(e)
    assert verdict == "REFUSED"
    (weak,) = [reason for reason in reasons if reason.code == "fit.most-poor"]
    assert weak.figures["reason"].code == cause


def test_verdict_and_remarks_use_the_sums_of_the_evidence(monkeypatch):
    e = evidence([step(k, 0.5, 0.5) for k in range(6)] + [step(6, 0.5, -0.5)])
    expected = fit_verdict(e), remarks(e)
    monkeypatch.setattr(verdicts, "group_channels", None)  # it reads every row of a fit
    assert (fit_verdict(e), remarks(e)) == expected


def test_the_squares_of_a_channel_are_in_units_of_its_noise():
    residuals, signal = np.full(20_000, 0.1), np.tile([-1.0, 1.0], 10_000)
    channel = ChannelFit("long", "odometer", 0, signal, signal, signal - residuals, 0.05, 1.0, 0.0)
    (of_run,) = group_channels([channel], None)["odometer[0]"]
    assert of_run.squares == pytest.approx(20_000 * (0.1 / 0.05) ** 2, rel=1e-12)
    assert of_run.signal_squares == pytest.approx(20_000 * (1.0 / 0.05) ** 2, rel=1e-12)


def test_a_channel_that_contradicts_the_model_in_most_runs_is_refused():
    verdict, reasons = fit_verdict(evidence([step(k, 0.5, -0.5) for k in range(6)] + [step(6, 0.5, 0.5)]))
    assert verdict == "REFUSED"
    assert reasons[0].code == "fit.channel-far-from-model"


def test_many_short_runs_at_constant_speed_identify_the_gain():
    """Commands are in volts; each run contains one reading of an odometer."""
    rng, runs = np.random.default_rng(0), []
    for k in range(200):
        u, t_ns = np.full((2, 1), rng.uniform(-12.0, 12.0)), 10**10 * k + 100_000_000 * np.arange(1, 3)
        z = 0.04 * u[1:] + rng.normal(0.0, 0.01, (1, 1))
        odometer = Channel(t_ns[1:], t_ns[1:], z)
        runs.append(
            Run(f"tuple {k}", None, t_ns, np.hstack([u, 0.0 * u, 0.0 * u]), sensors={"odometer": odometer})
        )
    fit = identify(runs, parse(CART, "cart"), ["model.velocity_matrix[0,0]"])
    assert fit.verdict == "USABLE"
    assert abs(fit.value("model.velocity_matrix[0,0]") - 0.04) < 4.0 * fit.std[0]


def test_jumps_of_the_prediction_are_not_explained_variance():
    """A kinematic model jumps at each change of a command, and predicts impulses of acceleration that do not occur."""
    rng = np.random.default_rng(0)
    z, h = rng.normal(0.0, 0.3, 2000), np.zeros(2000)
    h[::100] = 40.0
    assert explained_variance(z, h, 0.3) < 0.0
