"""Define `baqueano study`: reproduce the case studies."""

from collections.abc import Collection, Iterable
from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.modelling.sweep import matching_names
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.subcommands import SubcommandGroup
from baqueano.cli.terminal import print_answer, print_result, show_activity, show_progress, show_steps
from baqueano.diagnostics import Verdict, nearest, note
from baqueano.errors import AnswerNo, Interruption, UsageError


@click.group(cls=SubcommandGroup, help="Reproduce the paper's case studies; test with recordings.")
def command() -> None: ...


def _check_cases(cases: Iterable[str], case_names: Collection[str]) -> None:
    """Raise UsageError for the first case that is unknown."""
    for case in cases:
        if case not in case_names:
            raise UsageError.of("cli.case-unknown", value=case, suggestion=nearest(case, case_names))


def _check_complete(completed_count: int, requested_count: int) -> None:
    """Raise Interruption if Ctrl-C ended the study early."""
    if completed_count < requested_count:
        raise Interruption.of("cli.study-interrupted", count=completed_count, total=requested_count)


@command.command(
    "paper",
    help=(
        "Reproduce case study I of the paper: its table with its errors and those of this "
        "package, both models, and both figures."
    ),
)
@options.seed
@options.seeds(1, help="Number of seeds to fit, counted from --seed.")
@options.backend
@report_options
@options.as_json
def paper(seed: int, seed_count: int, backend: str, report: ReportFiles, as_json: bool) -> None:
    from baqueano.study.paper import dynamic_vs_kinematic
    from baqueano.study.paper.case_study import ImpliedParameters, case_study, simulate_seed
    from baqueano.study.paper.page import paper_page

    with show_progress(note("cli.study-paper", seeds=seed_count), seed_count) as advance:
        result = case_study(seed, seed_count, backend, advance)
    print_answer(result, as_json)
    with show_activity(note("cli.two-models")):
        run, validation_run = simulate_seed(seed, backend)[1], simulate_seed(seed + 1_000, backend)[1]
        models = dynamic_vs_kinematic.compare_models(result.fits[0], run, validation_run, backend)
    if not as_json:
        print_result(f"\n{dynamic_vs_kinematic.table(models)}\n\n{ImpliedParameters().table()}")
    report.write_table(result)
    report.write(lambda: paper_page(result, models, backend), Path("study-paper.html"))


@command.command(
    "identification",
    help="Fit robots and cars of a second simulator; compare errors and intervals with "
    "the truth and the Cramér-Rao bound.",
)
@options.seed
@options.seeds(200, help="Number of seeds, counted from --seed.")
@click.option(
    "--case",
    "cases",
    multiple=True,
    help=("Case to study, such as clean or understeer. Repeat the option for more; default: all."),
)
@options.drives_folder
@options.backend
@report_options
@options.as_json
def identification(
    seed: int, seed_count: int, cases: tuple[str, ...], drives_folder: Path | None, backend: str, report: ReportFiles,
    as_json: bool,
) -> None:  # fmt: skip
    from baqueano.study.identification import identification
    from baqueano.study.identification.page import identification_page
    from baqueano.study.identification.trials import CASES
    from baqueano.sweep.workers import processor_count

    _check_cases(cases, CASES)
    with show_progress(note("cli.study-identification", seeds=seed_count), seed_count) as advance:
        result = identification(
            seed_count,
            seed,
            backend,
            processor_count(),
            advance,
            cases=cases or CASES,
            drives_folder=drives_folder,
        )
    print_answer(result, as_json)
    report.write_table(result)
    report.write(lambda: identification_page(result), Path("study-identification.html"), reproducible=True)
    _check_complete(result.seeds, seed_count)


@command.command(
    "faults",
    help=(
        "Fit damaged recordings, and vehicles with effects outside the models; "
        "count the wrong fits with the verdict USABLE."
    ),
)
@options.seed
@options.seeds(20, help="Number of seeds of each fault, counted from --seed.")
@options.backend
@options.as_json
def faults(seed: int, seed_count: int, backend: str, as_json: bool) -> None:
    from baqueano.study.faults import FAULTS, faults
    from baqueano.sweep.workers import processor_count

    count = seed_count * len(FAULTS)
    with show_progress(note("cli.study-faults", count=count), count) as advance:
        result = faults(seed_count, seed, processes=processor_count(), backend=backend, advance=advance)
    print_answer(result, as_json)
    _check_complete(result.ended_count, result.fit_count)
    if result.verdict == Verdict.REFUSED:
        raise AnswerNo.of("cli.detectors-failed", reasons="; ".join(result.reasons))


@command.command(
    "driving",
    help="Drive identified robots of a second simulator on three routes, and measure the fluctuations of their speed.",
)
@options.seed
@options.seeds(100, help="Number of robots, with seeds counted from --seed.")
@click.option(
    "--controller",
    metavar="KIND",
    help=('Controller to use instead of pd_feedforward: a name, or "file.py:Class".'),
)
@options.backend
@options.as_json
def driving(seed: int, seed_count: int, controller: str | None, backend: str, as_json: bool) -> None:
    from baqueano.study.driving import driving
    from baqueano.sweep.workers import processor_count

    with show_progress(note("cli.study-driving", seeds=seed_count), seed_count) as advance:
        result = driving(seed_count, seed, processor_count(), backend, controller=controller, advance=advance)
    print_answer(result, as_json)
    _check_complete(result.robot_count, seed_count)


@command.command(
    "controllers",
    help="Compare all controllers on identified robots of a second simulator, with a known pose and with an estimate.",
)
@options.seed
@options.seeds(100, help="Number of robots, with seeds counted from --seed.")
@click.option(
    "--with",
    "own_kinds",
    multiple=True,
    metavar="KIND",
    callback=matching_names,
    help=(
        'Your own block, compared with ours: "file.py:Class", or "*/file.py:Class" for all such files. Repeat the '
        "option for more."
    ),
)
@options.backend
@options.as_json
def controllers(seed: int, seed_count: int, own_kinds: tuple[str, ...], backend: str, as_json: bool) -> None:
    from baqueano.study.controllers import controllers
    from baqueano.sweep.workers import processor_count

    with show_progress(note("cli.study-controllers", seeds=seed_count), seed_count) as advance:
        result = controllers(seed_count, seed, processor_count(), backend, own_kinds, advance=advance)
    print_answer(result, as_json)
    _check_complete(result.robots, seed_count)


@command.command(
    "laps",
    help=(
        "Drive fifty laps with an IMU alone, over two tags, over three lines, or through a pose gate. Test "
        "if robots keep to their route, and if the filter reports its errors correctly."
    ),
)
@options.seed
@options.seeds(20, help="Number of robots, with seeds counted from --seed.")
@click.option(
    "--laps", type=numbers.count, default=50, show_default=True, help=("Number of laps of each shape.")
)
@click.option(
    "--case",
    "case_filters",
    multiple=True,
    metavar="WORDS",
    help=(
        'Cases to study: those whose row contains these words, such as "tags, '
        'uncalibrated". Repeat the option for more; default: all.'
    ),
)
@options.backend
@options.as_json
def laps(
    seed: int, seed_count: int, laps: int, case_filters: tuple[str, ...], backend: str, as_json: bool
) -> None:
    from baqueano.study.laps import all_cases, study_fix_laps
    from baqueano.sweep.workers import processor_count

    words = [[word.strip() for word in name.split(",")] for name in case_filters]
    all_words = sorted({word for case in all_cases() for word in case})
    _check_cases([word for filter_words in words for word in filter_words], all_words)
    cases = [
        case
        for case in all_cases()
        if not words or any(set(filter_words) <= set(case) for filter_words in words)
    ]
    with show_progress(note("cli.study-laps", seeds=seed_count, laps=laps), seed_count) as advance:
        result = study_fix_laps(seed_count, seed, laps, processor_count(), backend, cases, advance)
    print_answer(result, as_json)
    _check_complete(result.robots, seed_count)


@command.command(
    "recordings",
    help=("Fit models of real vehicles to one part of a recording, and test them on another part."),
)
@options.backend
@report_options
@options.as_json
def recordings(backend: str, report: ReportFiles, as_json: bool) -> None:
    from baqueano.study.cross_validation_cpm import cross_validate
    from baqueano.study.recordings import CPM_MAPS, map_files, missing_paths, recordings
    from baqueano.study.recordings_page import make_recordings_page

    with show_steps() as begin:
        result = recordings(backend, begin)
    print_answer(result, as_json)
    if result.is_interrupted:
        from baqueano.errors import Interruption

        raise Interruption.of("cli.recordings-interrupted")
    with show_steps() as begin:
        study = None if missing_paths(map_files(CPM_MAPS)) else cross_validate(backend, begin)
    report.write_table(result)
    report.write(lambda: make_recordings_page(result, study), Path("study-recordings.html"))


@command.command(
    "experiments",
    help=(
        "Compare the information of a designed experiment with that of four other signals in the same room."
    ),
)
@options.seed
@options.seconds
@options.backend
@options.as_json
def experiments(seed: int, seconds: float, backend: str, as_json: bool) -> None:
    from baqueano.study.experiments import experiments
    from baqueano.sweep.workers import processor_count

    with show_steps() as begin:
        result = experiments(seed, seconds, processor_count(), backend, begin)
    print_answer(result, as_json)


@command.command("first-drives", help="Make first drives of unknown vehicles in a small room.")
@options.seed
@options.seeds(40, help="Number of vehicles, with seeds counted from --seed.")
@options.backend
@options.as_json
def first_drives(seed: int, seed_count: int, backend: str, as_json: bool) -> None:
    from baqueano.study.first_drives import first_drives
    from baqueano.sweep.workers import processor_count

    with show_progress(note("cli.study-first-drives", seeds=seed_count), seed_count) as advance:
        result = first_drives(seed_count, seed, processor_count(), backend, advance)
    print_answer(result, as_json)
    _check_complete(sum(row.drives for row in result.wiring_rows), seed_count)


@command.command(
    "without-encoders",
    help=(
        "Fit a real car with its commands and IMU alone; test with the odometer, which the fit does not use."
    ),
)
@options.backend
@options.as_json
def fit_imu_only(backend: str, as_json: bool) -> None:
    from baqueano.study.imu_only import imu_only_study

    with show_steps() as begin:
        result = imu_only_study(backend, begin)
    print_answer(result, as_json)


@command.command(
    "estimation",
    help="Compare estimators with the model and with plain integration: fit to one run, and test on another run.",
)
@click.option(
    "--estimator",
    "kinds",
    multiple=True,
    help=("Estimator to study instead of the estimator of the vehicle file. Repeat the option for more."),
)
@click.option(
    "--case",
    "cases",
    multiple=True,
    help=("Recordings to use: cpm, dart, dart bag or simulated. Repeat the option for more; default: all."),
)
@click.option(
    "--seeds", "seed_count", type=numbers.count_or_none, default=20, show_default=True,
    help="Number of simulated vehicles, about 20 s each.",
)  # fmt: skip
@options.backend
@options.as_json
def estimation(
    kinds: tuple[str, ...], cases: tuple[str, ...], seed_count: int, backend: str, as_json: bool
) -> None:
    from baqueano.study.estimation import CASES, estimation
    from baqueano.sweep.workers import processor_count

    _check_cases(cases, CASES)
    with show_steps() as begin:
        result = estimation(seed_count, backend, begin, cases or CASES, kinds, processor_count())
    print_answer(result, as_json)


@command.command(
    "corridor",
    help=(
        "Identify and drive vehicles of a second simulator: test if the corridor of the filter contains them."
    ),
)
@options.seed
@click.option(
    "--vehicles",
    type=numbers.count,
    default=100,
    show_default=True,
    help=("Number of vehicles, counted from --seed, about 8 s each."),
)
@click.option("--recordings/--no-recordings", default=True, help="Also test with parts of recorded drives.")
@options.backend
@options.as_json
def corridor(seed: int, vehicles: int, recordings: bool, backend: str, as_json: bool) -> None:
    from baqueano.study.corridor import corridor, with_recordings
    from baqueano.sweep.workers import processor_count

    with show_progress(note("cli.study-corridor", vehicles=vehicles), vehicles) as advance:
        result = corridor(vehicles, seed, processor_count(), backend, advance)
    if recordings:
        with show_steps() as begin:
            result = with_recordings(result, backend, begin)
    print_answer(result, as_json)
    _check_complete(result.vehicles + len(result.refused_robots), vehicles)
