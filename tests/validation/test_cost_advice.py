"""The recommended cost has the smaller open-loop error on held-out runs of the independent truth."""

from dataclasses import replace
from importlib import import_module

import pytest

from baqueano.cli import main
from baqueano.diagnostics import note
from baqueano.identify import FitOptions, identify
from baqueano.messages import text
from baqueano.runs import write_run
from baqueano.selection.choice import Choice
from baqueano.symbolic import with_value
from baqueano.validation.cost_advice import is_fit_by_innovations, relative_error_change, with_cost_advice
from baqueano.validation.held_out import ChannelMetrics, Validation, validate
from tests.identify.true_drives import CASE_FLOOR, case_drives, case_file

FREE = ["model.friction.linear", "model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]"]


@pytest.fixture(scope="module")
def drives():
    """Drives of case study I over a rough floor: a run to fit and a held-out run."""
    return case_drives([1, 2], 40.0, case_file({"model.process_noise_std": list(CASE_FLOOR)}))


@pytest.fixture(scope="module")
def fits(drives):
    """Return the fit by each cost."""
    run, file = drives[0].run, drives[0].file
    costs = "simulation", "innovations"
    return {cost: identify(run, file, FREE, options=FitOptions(cost=cost)) for cost in costs}


def biased(fit):
    """Return the fit with 30 % more friction."""
    path = "model.friction.linear"
    return replace(fit, blocks=with_value(fit.blocks, path, 1.3 * fit.blocks.model.friction.linear))


def advised(fits, drives, cost, other):
    """Return the first note of the fit by `cost`, if the fit by the other cost is `other`."""
    held_out = [drives[1].run]
    fit = fits[cost]
    costs = []

    def refit(cost):
        costs.append(cost)
        return other

    advice = with_cost_advice(fit, held_out, validate(fit, held_out), refit).notes[0]
    assert costs == ["innovations" if cost == "simulation" else "simulation"]
    return advice


def test_innovations_are_recommended_if_their_held_out_error_is_smaller(fits, drives):
    simulation = {"simulation": biased(fits["simulation"])}
    advice = advised(simulation, drives, "simulation", fits["innovations"])
    assert (advice.code, advice.fix) == ("cost.try-innovations", "--cost innovations")
    assert advice.figures["cause"].code == "cost.held-out-smaller"


def test_a_larger_held_out_error_overrides_the_recommendation_from_segments(fits, drives):
    assert fits["simulation"].notes[0].code == "cost.try-innovations"
    advice = advised(fits, drives, "simulation", biased(fits["innovations"]))
    assert (advice.code, advice.fix) == ("cost.held-out-larger", "")
    assert advice.figures["percent"] > 0.0


def test_a_fit_by_innovations_receives_the_same_recommendation(fits, drives):
    assert is_fit_by_innovations(fits["innovations"])
    assert not is_fit_by_innovations(fits["simulation"])
    assert advised(fits, drives, "innovations", biased(fits["simulation"])).code == "cost.held-out-smaller"


def test_short_held_out_runs_do_not_change_the_recommendation(fits, drives):
    fit, short = fits["simulation"], [drives[1].run.cut(0.0, 3.0)]
    assert with_cost_advice(fit, short, validate(fit, short), None) is fit


@pytest.mark.parametrize("options", [[], ["--choose"]])
def test_identify_prints_the_recommendation_by_held_out_runs(
    options, case, case_run, tmp_path, monkeypatch, capsys
):
    advice = note("cost.held-out-larger", percent=3.0)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        import_module("baqueano.validation.cost_advice"),
        "with_cost_advice",
        lambda fit, runs, validation, refit: replace(fit, notes=(advice, *refit("innovations").notes[:0])),
    )
    case.save(tmp_path / "vehicle.toml")
    for seed, name in enumerate(("one", "two")):
        write_run(case_run(seed, 10.0, name=name), tmp_path / f"{name}.mcap")
    monkeypatch.setattr(
        import_module("baqueano.selection.choose"),
        "choose",
        lambda runs, file, **settings: Choice((), identify(runs, file, ["model.mass_kg"]), ""),
    )
    with pytest.raises(SystemExit):
        main(
            [
                "identify",
                "one.mcap",
                "--held-out",
                "two.mcap",
                "--no-noise",
                "--free",
                "model.mass_kg",
                *options,
            ]
        )
    assert text(advice) in " ".join(capsys.readouterr().out.split())


def test_the_error_sums_all_channels_in_units_of_their_noise():
    def validation(*errors):
        figures = [ChannelMetrics("r", f"imu[{k}]", e, 0.9, 0.9, "", 2.0) for k, e in enumerate(errors)]
        return Validation(tuple(figures), (), (), (), note("validation.basis"))

    assert relative_error_change(validation(2.0, 2.0), validation(2.0, 4.0)) == pytest.approx(1.5)
    assert relative_error_change(validation(), validation(1.0)) == 0.0
