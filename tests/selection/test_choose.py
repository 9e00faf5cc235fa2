"""A model receives exactly the terms that its vehicle has, chosen by simulation error on omitted segments or runs.

False-alarm rates for correct code: a vehicle without terms receives one with a probability below 5 % (0 of 20
seeds). So 2 of 4 or more have a probability below 1.5 %. Both terms of the other vehicle were chosen in 20 of 20
seeds. One additional term has a probability below 5 % each, so 2 of 3 or more below 1 %. The seeds are fixed.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from baqueano.cli import main
from baqueano.diagnostics import note
from baqueano.errors import UsageError
from baqueano.identify import FitOptions, random_steps
from baqueano.identify.battery import separation_problem
from baqueano.identify.data.record import FittedBlocks
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.parameter import parameters
from baqueano.runs import write_run
from baqueano.runs.run import Channel
from baqueano.selection.choose import choose
from baqueano.selection.cross_validation import Score, paired_comparison
from baqueano.selection.terms import Term, vehicle_terms, without_terms
from baqueano.simulate import simulate
from baqueano.study.counterpart import drive_runs
from baqueano.study.counterpart.world import ROBOT_STEP_S
from baqueano.study.faults.subject import subject
from baqueano.study.identification.trials import draw_robot, initial_file, quantised_commands
from baqueano.vehicle_file import load
from tests.codes import of_code

USE = ("odometer", "imu[2]")
COMMANDS = np.concatenate([np.eye(3), -np.eye(3)])
RATE = {name: 25.0 for name in ("rate_hz", "sensors.imu.rate_hz", "sensors.odometer.rate_hz")}
DRY = {
    "model.coulomb_m_s2": 0.4,
    "model.drivetrain.dead_zone_forward": [0.06, 0.0],
    "model.drivetrain.dead_zone_backward": [0.08, 0.0],
}


def drive(file, seed, duration_s=40.0):
    u = random_steps([0.5, 0.8], duration_s, file.rate_hz, seed)
    return simulate(file, u, seed, name=f"run {seed}")


@pytest.fixture(scope="module")
def file():
    """Return the car of the garage with all its terms."""
    return load("car").with_values(RATE)


@pytest.fixture(scope="module")
def core(file):
    """Return the same car without any terms."""
    return without_terms(
        file, vehicle_terms(FittedBlocks(file.vehicle, file.sensors), np.concatenate([np.eye(2), -np.eye(2)]))
    )


@pytest.fixture(scope="module")
def dry(core):
    """Return a car with dry friction and a dead zone, and without quadratic drag."""
    return core.with_values(DRY)


@pytest.fixture(scope="module")
def choice(dry, file):
    return choose(drive(dry, 0), file, use=USE)


def test_no_term_is_chosen_for_a_vehicle_without_terms(core, file):
    choices = [choose(drive(core, seed), file, use=USE).selected_terms for seed in range(4)]
    assert sum(len(names) > 0 for names in choices) <= 1, choices


def test_dry_friction_and_dead_zone_are_chosen_and_rarely_others(dry, file, choice):
    choices = [
        choice.selected_terms,
        *(choose(drive(dry, seed), file, use=USE).selected_terms for seed in range(1, 3)),
    ]
    for names in choices:
        paths = " ".join(names)
        assert "dry friction" in names
        assert "dead zone" in paths
    assert sum(len(names) > 2 for names in choices) <= 1, choices


def test_chosen_terms_get_true_values_and_other_terms_neutral_values(choice, file):
    fit = choice.fit
    assert abs(fit.value("model.coulomb_m_s2") - 0.4) < 4.0 * fit.std[fit.names.index("model.coulomb_m_s2")]
    name = "model.drivetrain.dead_zone_backward[0]"
    assert abs(fit.value(name) - 0.08) < 4.0 * fit.std[fit.names.index(name)]
    assert file.value("model.quadratic_drag") > 0.0
    assert choice.vehicle_file.value("model.quadratic_drag") == 0.0
    assert choice.vehicle_file.value("model.drivetrain.delay_s") == 0.0


def test_each_chosen_or_rejected_term_is_reported_with_its_figures(choice):
    message = next(
        judgement.message for judgement in choice.term_results if judgement.term.name == "dry friction"
    )
    assert (message.code, message.figures["channel"]) == ("choose.taken", "speed")
    assert message.figures["errors"] > message.figures["threshold"]
    with use_language("es"):
        assert "fricción seca" in text(message)
        assert "dry friction" not in choice.table()
    rejections = [judgement for judgement in choice.term_results if judgement.verdict == "excluded"]
    assert rejections
    assert {judgement.message.code for judgement in rejections} <= {"choose.left-out", "choose.left-out-for"}
    assert "This limits how often a vehicle without such terms gets one" in choice.table()


def test_one_step_errors_are_shown_but_do_not_decide(choice):
    """The term that lowers the held-out error by a third hardly changes the one-step error."""
    row = next(row for row in choice.rows() if row.get("term") == "dry friction")
    assert row["error_with"] < 0.8 * row["error_without"]
    assert row["one_step_with"] > 0.9 * row["one_step_without"]
    assert "Such scores prove nothing, and were not used." in choice.table()


def test_the_table_refers_to_the_report_for_omitted_notes(choice):
    long_choice = replace(
        choice, fit=replace(choice.fit, notes=tuple(note(f"any.{letter}") for letter in "abcdef"))
    )
    assert long_choice.table().endswith(' more: bq.report(fit, "fit.html") shows all, with figures')
    assert long_choice.table(reported=True).endswith(" more: the report shows all, with figures")


def test_many_runs_are_cross_validated_by_whole_runs(dry, file):
    runs = [drive(dry, seed, 12.0) for seed in range(8)]
    choice = choose(runs, file, ["dry friction", "quadratic drag"], use=USE)
    assert choice.selected_terms == ("dry friction",)
    assert "(whole runs; 40 blocks of about 2." in choice.rule


def test_a_term_at_its_bound_is_refused(dry, file):
    limit = {"model.coulomb_m_s2": (0.0, 0.1)}
    choice = choose(drive(dry, 0), file, ["dry friction"], use=USE, options=FitOptions(bounds=limit))
    assert choice.selected_terms == ()
    (message,) = (judgement.message for judgement in choice.term_results)
    cause = message.figures["reason"]
    assert (message.code, cause.code, cause.subject) == (
        "choose.refused",
        "bound.high-held",
        "model.coulomb_m_s2",
    )


@pytest.mark.parametrize("emf", [1.0, 0.0])
def test_a_back_emf_is_chosen_if_the_current_lags(emf):
    case, names = subject("robot", 502), ["motor lag", "back-EMF behind the lag"]
    u = case.signal(20.0)
    (run,) = case.runs([case.vehicle.with_parameters(lagging_emf=np.full(1, emf))], [u], [u])
    free = ["model.actuator_matrix[0,0]", "model.actuator_matrix[2,2]", "model.friction.linear"]
    choice = choose(run, case.vehicle_file, names, free=free)
    assert choice.selected_terms == tuple(names[: 1 + round(emf)])


def test_a_term_is_tried_only_with_the_term_that_it_requires(small):
    terms = {term.name: term for term in vehicle_terms(FittedBlocks(small.vehicle, small.sensors), COMMANDS)}
    required_paths = {term.requires for term in terms.values() if term.paths[0].endswith("back_emf_share")}
    assert required_paths == {terms["motor lag"].paths[0]}
    assert terms["delay"].requires == ""
    names = {p.term for _, p in parameters(small.vehicle.drivetrain) if p.term}
    assert names - terms.keys() == {"servo lag"}  # without a servo


def test_a_term_that_duplicates_a_fitted_parameter_is_refused(dry, file):
    gain = Term("gain of the motor", ("model.drivetrain.gain[0]",), (1.0,), ((1.2,),))
    choice = choose(drive(dry, 0), file, [gain], use=USE)
    assert choice.selected_terms == ()
    assert choice.term_results[0].reason.code in ("term.same-as-others", "term.not-identifiable")


def test_a_battery_that_hardly_moves_is_not_identifiable(dry, file):
    run = drive(dry, 0)
    volts = 6.0 + 0.01 * np.sin(run.t_s)[:, None]
    logged_run = replace(run, sensors={**run.sensors, "battery": Channel(run.t_ns, run.t_ns, volts)})
    choice = choose(logged_run, file, ["dry friction", "battery voltage"], use=USE)
    assert choice.selected_terms == ("dry friction",)
    assert choice.sentences[1].startswith("battery voltage")


def test_too_short_runs_are_refused_with_their_length(dry, file):
    with pytest.raises(UsageError, check=of_code("choose.short", min_s=12.0)):
        choose(drive(dry, 0, 8.0), file, use=USE)


def test_an_unknown_term_is_refused_with_the_list_of_terms(dry, file):
    with pytest.raises(UsageError, check=of_code("choose.no-term")):
        choose(drive(dry, 0), file, ["dry fiction"], use=USE)


def test_choosing_without_a_run_is_refused(file):
    with pytest.raises(UsageError, check=of_code("choose.no-command")):
        choose([], file)


def scores(loss):
    """Return the scores of a model with these losses (B,) of blocks of ten measurements each."""
    loss = np.asarray(loss, float)[:, None]
    zero, unit = np.zeros(1), np.ones(1)
    return Score(loss, np.full(loss.shape, 10.0), zero, unit, np.zeros((5, 1)), unit)


def test_terms_are_tested_by_students_t_on_the_log_error_of_blocks():
    g = 0.1 + np.resize([0.1, -0.1], 24)
    before = np.full(24, 10.0)
    after = (before + 1.0) * np.exp(-2.0 * g) - 1.0  # 1 = FLOOR of ten measurements
    comparison = paired_comparison(scores(before), scores(after))
    assert comparison.gain == pytest.approx(0.1)
    assert comparison.errors == pytest.approx(0.1 / (np.std(g, ddof=1) / np.sqrt(24)))
    assert comparison.critical_value(0.01) == pytest.approx(2.4999, abs=3e-3)  # t of 23 degrees of freedom


def test_blocks_at_rest_do_not_affect_the_choice():
    moving, resting = np.full(10, 10.0), np.array([1e-9, 1e-6] * 5)
    comparison = paired_comparison(
        scores(np.concatenate([moving, resting])), scores(np.concatenate([moving, resting[::-1]]))
    )
    assert abs(comparison.gain) < 1e-5


def test_a_larger_total_error_is_refused_even_if_most_blocks_improve():
    before = np.full(20, 10.0)
    after = np.concatenate([np.full(19, 9.0), [1000.0]])
    assert paired_comparison(scores(before), scores(after)).errors <= 0.0


def test_a_model_that_diverges_in_one_block_is_not_better():
    comparison = paired_comparison(scores(np.full(8, 10.0)), scores([np.inf, *np.full(7, 1.0)]))
    assert comparison.errors == -np.inf


@pytest.fixture
def in_a_folder(dry, file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file.save(tmp_path / "my.toml")
    write_run(drive(dry, 0), tmp_path / "dry.mcap")


ARGUMENTS = (
    "dry.mcap",
    "--vehicle",
    "my.toml",
    "--choose",
    "--use",
    "odometer",
    "--use",
    "imu[2]",
    "--no-noise",
)


def test_the_command_line_prints_rows_and_writes_the_chosen_model(in_a_folder, choice, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["identify", *ARGUMENTS, "--update", "--json"])
    assert exit_info.value.code == 0
    reply = json.loads(capsys.readouterr().out)
    terms = {row["term"]: row for row in reply["rows"] if "term" in row}
    assert {name for name, row in terms.items() if row["verdict"] == "added"} == set(choice.selected_terms)
    assert terms["quadratic drag"]["verdict"] == "excluded"
    names = {row["name"] for row in reply["rows"] if "name" in row}
    assert "model.coulomb_m_s2" in names
    assert "model.quadratic_drag" not in names
    assert load("my.toml").value("model.quadratic_drag") == 0.0


def test_options_that_conflict_with_choose_are_refused(in_a_folder, capsys):
    with pytest.raises(SystemExit) as exit_info:
        main(["identify", *ARGUMENTS, "--speed-noise"])
    assert exit_info.value.code == 2
    assert "--choose cannot be combined with --speed-noise. First choose" in capsys.readouterr().err


def test_terms_are_chosen_by_their_error_on_validation_runs(dry, core, file):
    """The fitted car has dry friction: the term is chosen if held-out runs have it too, otherwise it is rejected."""
    choices = [
        choose(drive(dry, 0, 20.0), file, ["dry friction"], use=USE, held_out=[drive(truth, 1, 20.0)])
        for truth in (dry, core)
    ]
    assert [choice.selected_terms for choice in choices] == [("dry friction",), ()]
    assert "tested by its simulation of the 1 held-out runs (10 blocks of about 2.0 s)" in choices[0].rule
    assert choices[0].fit.runs == ("run 0",)


def test_a_fitted_run_cannot_be_a_validation_run(dry, file):
    run = drive(dry, 0)
    with pytest.raises(UsageError, check=of_code("runs.fitted-to", run="run 0")):
        choose(run, file, use=USE, held_out=[replace(run)])


def test_too_short_validation_runs_are_refused(dry, file):
    with pytest.raises(UsageError, check=of_code("choose.short")):
        choose(drive(dry, 0), file, use=USE, held_out=[drive(dry, 1, 8.0)])


@pytest.mark.parametrize(("effect", "fall_v", "verdict"), [(1.0, 2.0, "added"), (2.7, 0.6, "refused")])
def test_a_battery_term_is_chosen_only_if_the_runs_identify_its_effect(dry, file, effect, fall_v, verdict):
    """A bridge does not drop most of the voltage: something else changed together with the voltage."""
    u = random_steps([0.5, 0.8], 40.0, dry.rate_hz, 0)
    volts = np.linspace(6.0 + fall_v / 2, 6.0 - fall_v / 2, len(u))
    motor = np.stack([1.0 + effect * (volts / 6.0 - 1.0), np.ones(len(u))], axis=1)
    run = simulate(dry, u * motor, 0)
    battery = Channel(run.t_ns, run.t_ns, volts[:, None])
    run = replace(run, applied_commands=u, sensors={**run.sensors, "battery": battery})
    judgements = choose(run, dry, ["battery voltage", "dry friction"], use=USE).term_results
    judgement = next(
        term_judgement for term_judgement in judgements if term_judgement.term.name == "battery voltage"
    )
    assert judgement.verdict == verdict, judgement.message
    if verdict == "refused":
        assert (judgement.message.code, judgement.reason.code) == ("choose.refused", "term.battery-outside")


@pytest.mark.parametrize(
    ("x", "std", "nominal_v", "code"),
    [
        (2.2, 0.65, 6.0, "term.battery-not-separable"),
        (0.5, 0.3, 6.0, "term.battery-not-separable"),
        (0.8, 0.1, 6.0, None),
        (1.1, 0.02, 6.0, None),
        (1.5, 0.02, 7.4, None),  # an L298 that drops 2.5 V
        (1.5, 0.02, 12.0, "term.battery-outside"),  # 3.2 V of 12 V are at most 1.36
        (2.2, 0.02, 3.7, "term.battery-outside"),
        (-0.2, 0.05, 6.0, "term.battery-outside"),
    ],
)
def test_a_battery_term_needs_a_narrow_interval_in_its_possible_range(x, std, nominal_v, code):
    problem = separation_problem(x, std, nominal_v)
    assert (problem and problem.code) == code


@pytest.mark.parametrize(("drop_v", "is_chosen"), [(2.0, True), (None, False)])
def test_a_battery_term_is_chosen_for_the_motors_behind_a_bridge(drop_v, is_chosen):
    """Motors at V − 2 V follow the voltage by 7.4 / 5.4 = 1.37; those of a regulated supply do not follow it."""
    robot = draw_robot(3).with_parameters(levels=np.full(1, 1e9), supply=np.full(1, 1.25))
    keys = {f"model.drivetrain.{key}": 7.4 for key in ("battery_v", "battery_nominal_v")}
    small, runs = initial_file(robot).with_values(keys), []
    for seed, volts in ((30, np.linspace(8.3, 7.6, 2500)), (31, np.linspace(7.3, 6.7, 2500))):
        u = 0.85 * quantised_commands(random_steps(small.command.limit, 25.0, 100.0, seed))
        supply = (volts - drop_v) / (7.4 - drop_v) if drop_v else np.ones(len(volts))
        (run,) = drive_runs([robot], [u * supply[:, None] / 1.25], [seed], [small], ROBOT_STEP_S)
        battery = Channel(run.t_ns, run.t_ns, volts[:, None])
        runs.append(replace(run, applied_commands=u, sensors={**run.sensors, "battery": battery}))
    terms = [
        "dead zone",
        "motor lag",
        "delay",
        "dry friction forward",
        "dry friction turning",
        "battery voltage",
    ]
    choice = choose(runs, small, terms)
    assert ("battery voltage" in choice.selected_terms) == is_chosen
    if is_chosen:
        k = choice.fit.names.index("model.drivetrain.battery_effect")
        assert abs(choice.fit.estimate[k] - 7.4 / 5.4) < 3.0 * choice.fit.std[k] < 1.0
    delay = [k for k, name in enumerate(choice.fit.names) if name == "model.drivetrain.delay_s"]
    assert not np.any(choice.fit.bound[delay])


def test_the_command_line_chooses_and_judges_by_the_validation_run(in_a_folder, dry, tmp_path, capsys):
    write_run(drive(dry, 1, 20.0), tmp_path / "other.mcap")
    with pytest.raises(SystemExit) as exit_info:
        main(["identify", *ARGUMENTS, "--held-out", "other.mcap"])
    assert exit_info.value.code == 0
    output = capsys.readouterr().out
    assert "tested by its simulation of the 1 held-out runs" in output
    assert "the model remains valid over 20 s in open loop" in output
