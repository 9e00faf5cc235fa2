"""Define `baqueano replay`: send the data of a run through blocks again, and compare."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.next_command import advise_to_fit
from baqueano.cli.page import live
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.terminal import print_answer, print_message, show_activity, show_time_progress
from baqueano.diagnostics import Diagnostic, note
from baqueano.messages import text


@click.command(help="Process RUN again with the same blocks, or with others, and compare.")
@click.argument("run")
@options.run_vehicle_option
@options.estimator
@options.align
@click.option(
    "--smooth",
    is_flag=True,
    help=("Smooth: estimate each instant from the whole run, later measurements included."),
)
@options.backend
@options.runs_folder
@options.out
@report_options
@live.page_flag
@options.as_json
def command(
    run: str, vehicle: str | None, settings: tuple[str, ...], estimator: str | None, align: str, smooth: bool,
    backend: str, folder: str, out: Path | None, report: ReportFiles, show_page: bool, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.compare import compare
    from baqueano.drive import drive_stop_reason, replay
    from baqueano.drive.observers import Progress
    from baqueano.drive.replay import recorded_vehicle_file
    from baqueano.vehicle_file import override

    with show_activity(note("cli.read-run"), is_delayed=True):
        recorded_run = options.find_runs((run,), folder)[0]
    vehicle_options = None
    if vehicle is None and recorded_run.vehicle_text:
        differs = options.DEFAULT_FILE.is_file() and _default_file_text() != recorded_run.vehicle_text
        print_message(note("cli.vehicle-of-run-differs" if differs else "cli.vehicle-of-run"))
        vehicle_file = recorded_vehicle_file(recorded_run)
        vehicle_file = override(vehicle_file, settings) if settings else vehicle_file
    else:
        vehicle_file = options.load_vehicle(vehicle, settings)
        vehicle_options = options.vehicle_and_runs_options(vehicle_file, folder)
    replay_backend = recorded_run.metadata.get("backend", "auto") if backend == "auto" else backend
    replay_estimator = vehicle_file.estimator(options.block_kind(vehicle_file, "estimator", estimator))
    path = options.run_path(out, folder, f"replay-{recorded_run.name.rsplit('-replay-', 1)[-1]}")
    with show_time_progress(note("cli.replay"), recorded_run.duration_s) as progress:
        replayed_run = replay(
            recorded_run,
            vehicle_file,
            estimator=replay_estimator,
            path=path,
            smooth=smooth,
            observers=(Progress(progress),),
            backend=replay_backend,
        )
    print_message(note("cli.run", path=path))
    drawn_runs = [recorded_run, replayed_run] if recorded_run.estimate is not None else [replayed_run]
    with show_activity(note("cli.compare"), is_delayed=True):
        comparison = compare(drawn_runs, alignment=align)
    print_answer(comparison, as_json)
    advise_to_fit(comparison, [recorded_run] * len(drawn_runs), folder, vehicle_options)
    report.write_table(comparison)
    if report:
        from baqueano.report.run_report import run_page

        original_run = recorded_run if recorded_run.estimate is not None else None
        report.write(lambda: run_page(replayed_run, align, original_run))
    if show_page:
        live.show_both(path, recorded_run.path, folder)
    # a stop that was recorded is replayed with the rest
    if not _stops_are_equal(drive_stop_reason(replayed_run), drive_stop_reason(recorded_run)):
        options.raise_stop(replayed_run, path)
    else:
        options.print_warnings(replayed_run)


def _default_file_text() -> str:
    return options.DEFAULT_FILE.read_text(encoding="utf-8", errors="replace")


def _stops_are_equal(stop: Diagnostic | None, recorded_stop: Diagnostic | None) -> bool:
    """Return True if both stops are the same. A stop that was recorded without a code is compared by its text."""
    return stop == recorded_stop or text(stop) == text(recorded_stop)
