"""baqueano study."""

import sys
from dataclasses import replace
from pathlib import Path

import click

from baqueano.cli import Verbs, numbers, options
from baqueano.cli.terminal import answer, busy, progress, steps, talk, tell
from baqueano.diagnostics import Verdict, fault, nearest, note
from baqueano.printable import typed


@click.group(cls=Verbs, help="Reproduce the paper's case studies; judge by recordings.")
def command() -> None: ...


@command.command(
    "paper", help="Case study I: the paper's table, its errors and ours, both models, both figures."
)
@options.seed
@click.option(
    "--seeds", type=numbers.count, default=1, show_default=True, help="Fits at so many seeds from --seed on."
)
@options.backend
@options.page
@options.as_json
def paper(seed: int, seeds: int, backend: str, page: Path | None, as_json: bool) -> None:
    from baqueano.study.paper import two_models
    from baqueano.study.paper.case_study import ImpliedParameters, case_study, recorded
    from baqueano.study.paper.page import page_of_paper

    with progress(note("cli.study-paper", seeds=seeds), seeds) as each:
        found = case_study(seed, seeds, backend, each)
    answer(found, as_json)
    with busy(note("cli.two-models")):
        run, unseen = recorded(seed, backend)[1], recorded(seed + 1_000, backend)[1]
        models = two_models.two_models(found.fits[0], run, unseen, backend)
    if not as_json:
        tell(f"\n{two_models.table(models)}\n\n{ImpliedParameters().table()}")
    with busy(note("cli.drawing")):
        written = page_of_paper(found, models, backend).save(page or Path("study-paper.html"))
    talk(note("cli.report", page=written))


@command.command(
    "identification",
    help="Robots and cars of a second simulator: errors against the Cramér-Rao bound, intervals, verdicts.",
)
@options.seed
@click.option("--seeds", type=numbers.count, default=200, show_default=True, help="From --seed on.")
@click.option(
    "--case", "cases", multiple=True, help="Only this one, such as clean or understeer; may be repeated."
)
@click.option(
    "--keep",
    type=click.Path(path_type=Path, file_okay=False),
    help="A folder for what is done, from which an interrupted study goes on. Delete it after a change of the code.",
)
@options.backend
@options.page
@options.as_json
def identification(
    seed: int, seeds: int, cases: tuple[str, ...], keep: Path | None, backend: str, page: Path | None, as_json: bool
) -> None:  # fmt: skip
    from baqueano.cli.errors import Interrupted
    from baqueano.errors import UsageError
    from baqueano.study.identification import identification
    from baqueano.study.identification.page import page_of_identification
    from baqueano.study.identification.trials import CASES
    from baqueano.sweep.workers import processors

    if unknown := [case for case in cases if case not in CASES]:
        raise UsageError(fault("cli.case-unknown", found=unknown[0], near=nearest(unknown[0], CASES)))
    with progress(note("cli.study-identification", seeds=seeds), seeds) as each:
        found = identification(seeds, seed, backend, processors(), each, cases=cases or CASES, keep=keep)
    answer(found, as_json)
    with busy(note("cli.drawing")):
        whole = replace(page_of_identification(found), reproduce=typed(*sys.argv[1:]))
        written = whole.save(page or Path("study-identification.html"))
    talk(note("cli.report", page=written))
    if found.seeds < seeds:
        raise Interrupted(fault("cli.study-interrupted", done=found.seeds, asked=seeds))


@command.command(
    "faults", help="Damaged recordings and effects that are in no model: is any wrong fit called usable?"
)
@options.seed
@click.option(
    "--seeds", type=numbers.count, default=20, show_default=True, help="Of each fault, from --seed on."
)
@options.backend
@options.as_json
def faults(seed: int, seeds: int, backend: str, as_json: bool) -> None:
    from baqueano.cli.errors import Interrupted
    from baqueano.errors import AnswerNo
    from baqueano.study.faults import FAULTS, faults
    from baqueano.sweep.workers import processors

    count = seeds * len(FAULTS)
    with progress(note("cli.study-faults", count=count), count) as each:
        found = faults(seeds, seed, processes=processors(), backend=backend, each=each)
    answer(found, as_json)
    if found.asked > found.tried:
        raise Interrupted(fault("cli.study-interrupted", done=found.tried, asked=found.asked))
    if found.verdict == Verdict.REFUSED:
        raise AnswerNo(fault("cli.detectors-failed", reasons="; ".join(found.reasons)))


@command.command(
    "driving", help="Identified robots of a second simulator on three routes: do they drive evenly?"
)
@options.seed
@click.option("--seeds", type=numbers.count, default=100, show_default=True, help="Robots, from --seed on.")
@click.option("--controller", metavar="KIND", help='In place of pd_feedforward: ours, or "file.py:Class".')
@options.backend
@options.as_json
def driving(seed: int, seeds: int, controller: str | None, backend: str, as_json: bool) -> None:
    from baqueano.cli.errors import Interrupted
    from baqueano.study.driving import driving
    from baqueano.sweep.workers import processors

    with progress(note("cli.study-driving", seeds=seeds), seeds) as each:
        found = driving(seeds, seed, processors(), backend, controller=controller, each=each)
    answer(found, as_json)
    if found.driven < seeds:
        raise Interrupted(fault("cli.study-interrupted", done=found.driven, asked=seeds))


@command.command(
    "marks",
    help="Fifty laps over two tags on the floor: do heading and position stay bounded, and as claimed?",
)
@options.seed
@click.option("--seeds", type=numbers.count, default=20, show_default=True, help="Robots, from --seed on.")
@click.option("--laps", type=numbers.count, default=50, show_default=True, help="Of each shape.")
@options.backend
@options.as_json
def marks(seed: int, seeds: int, laps: int, backend: str, as_json: bool) -> None:
    from baqueano.cli.errors import Interrupted
    from baqueano.study.marks import marks
    from baqueano.sweep.workers import processors

    with progress(note("cli.study-marks", seeds=seeds, laps=laps), seeds) as each:
        found = marks(seeds, seed, laps, processors(), backend, each=each)
    answer(found, as_json)
    if found.robots < seeds:
        raise Interrupted(fault("cli.study-interrupted", done=found.robots, asked=seeds))


@command.command("recordings", help="Real vehicles: fitted to one part of a recording, judged on another.")
@options.backend
@options.page
@options.as_json
def recordings(backend: str, page: Path | None, as_json: bool) -> None:
    from baqueano.cli.errors import Interrupted
    from baqueano.study.recordings import MAPS, files_of, missing_of, recordings
    from baqueano.study.recordings_page import page_of_recordings
    from baqueano.study.two_ways import two_ways

    with steps() as begin:
        found = recordings(backend, begin)
    answer(found, as_json)
    if found.stopped:
        raise Interrupted(fault("cli.recordings-interrupted"))
    with steps() as begin:
        study = None if missing_of(files_of(MAPS)) else two_ways(backend, begin)
    with busy(note("cli.drawing")):
        written = page_of_recordings(found, study).save(page or Path("study-recordings.html"))
    talk(note("cli.report", page=written))


@command.command(
    "experiments", help="How much a designed experiment tells, beside four other signals in the same room."
)
@options.seed
@click.option("--seconds", type=numbers.seconds, default=60.0, show_default=True, help="Length of a drive.")
@options.backend
@options.as_json
def experiments(seed: int, seconds: float, backend: str, as_json: bool) -> None:
    from baqueano.study.experiments import experiments
    from baqueano.sweep.workers import processors

    with steps() as begin:
        found = experiments(seed, seconds, processors(), backend, begin)
    answer(found, as_json)


@command.command("first-drives", help="Vehicles of which nothing is known, driven carefully in a small room.")
@options.seed
@click.option("--seeds", type=numbers.count, default=40, show_default=True, help="Vehicles, from --seed on.")
@options.backend
@options.as_json
def first_drives(seed: int, seeds: int, backend: str, as_json: bool) -> None:
    from baqueano.cli.errors import Interrupted
    from baqueano.study.first_drives import first_drives
    from baqueano.sweep.workers import processors

    with progress(note("cli.study-first-drives", seeds=seeds), seeds) as each:
        found = first_drives(seeds, seed, processors(), backend, each)
    answer(found, as_json)
    if (done := sum(row.drives for row in found.each)) < seeds:
        raise Interrupted(fault("cli.study-interrupted", done=done, asked=seeds))


@command.command(
    "without-encoders", help="A real car from its commands and its IMU alone, judged by the odometer it hid."
)
@options.backend
@options.as_json
def fit_imu_only(backend: str, as_json: bool) -> None:
    from baqueano.study.without_encoders import without_encoders_study

    with steps() as begin:
        found = without_encoders_study(backend, begin)
    answer(found, as_json)


@command.command(
    "estimation",
    help="Estimators against the model and plain integration, fitted to one run, judged on another.",
)
@click.option(
    "--estimator", "kinds", multiple=True, help="Judge this kind in place of the file's; may be repeated."
)
@click.option(
    "--case", "cases", multiple=True, help="Only cpm, dart, dart bag or simulated; may be repeated."
)
@click.option(
    "--seeds",
    type=click.IntRange(0),
    default=20,
    show_default=True,
    help="Simulated vehicles, some 20 s each.",
)
@options.backend
@options.as_json
def estimation(
    kinds: tuple[str, ...], cases: tuple[str, ...], seeds: int, backend: str, as_json: bool
) -> None:
    from baqueano.errors import UsageError
    from baqueano.study.estimation import CASES, estimation
    from baqueano.sweep.workers import processors

    if unknown := [case for case in cases if case not in CASES]:
        raise UsageError(fault("cli.case-unknown", found=unknown[0], near=nearest(unknown[0], CASES)))
    with steps() as begin:
        found = estimation(seeds, backend, begin, cases or CASES, kinds, processors())
    answer(found, as_json)


@command.command(
    "corridor",
    help="Vehicles of a second simulator, identified and driven: does the corridor of the filter hold them?",
)
@options.seed
@click.option(
    "--vehicles", type=numbers.count, default=100, show_default=True, help="From --seed on, some 8 s each."
)
@click.option("--recordings/--no-recordings", default=True, help="Windows of real drives too.")
@options.backend
@options.as_json
def corridor(seed: int, vehicles: int, recordings: bool, backend: str, as_json: bool) -> None:
    from baqueano.cli.errors import Interrupted
    from baqueano.study.corridor import corridor, with_recordings
    from baqueano.sweep.workers import processors

    with progress(note("cli.study-corridor", vehicles=vehicles), vehicles) as each:
        found = corridor(vehicles, seed, processors(), backend, each)
    if recordings:
        with steps() as begin:
            found = with_recordings(found, backend, begin)
    answer(found, as_json)
    if (done := found.vehicles + len(found.refused)) < vehicles:
        raise Interrupted(fault("cli.study-interrupted", done=done, asked=vehicles))
