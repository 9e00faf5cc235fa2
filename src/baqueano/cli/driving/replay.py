"""baqueano replay."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from baqueano.cli import options
from baqueano.cli.page import live
from baqueano.cli.terminal import answer, clocked, talk
from baqueano.diagnostics import note

if TYPE_CHECKING:
    from baqueano.diagnostics import Diagnostic


@click.command(help="Send RUN through the same blocks again, or through others, and compare.")
@click.argument("run")
@options.vehicle
@click.option("--estimator", metavar="FILE:CLASS", help="Estimator to use instead of that of the file.")
@click.option("--align", type=click.Choice(["none", "start", "rigid"]), default="none", show_default=True,
              help="Alignment of the estimated path with the true path.")  # fmt: skip
@click.option(
    "--smooth",
    is_flag=True,
    help=("Smooth: estimate each instant from the whole run, later measurements included."),
)
@options.backend
@options.runs_folder
@options.out
@options.page
@live.shown
@options.as_json
def command(
    run: str, vehicle: str | None, settings: tuple[str, ...], estimator: str | None, align: str, smooth: bool,
    backend: str, folder: str, out: Path | None, page: Path | None, shown: bool, as_json: bool,
) -> None:  # fmt: skip
    from dataclasses import replace

    from baqueano.compare import compare
    from baqueano.drive import replay, smoothed, stop_of
    from baqueano.drive.observers import Progress
    from baqueano.drive.verbs import vehicle_of
    from baqueano.runs import write_run
    from baqueano.runs.initial_pose import initial_pose
    from baqueano.vehicle_file import override

    recorded = options.find_runs((run,), folder)[0]
    named = options.naming_own(folder)
    if vehicle is None and recorded.vehicle_text:
        talk(note("cli.vehicle-of-run"))
        file = vehicle_of(recorded)
        file = override(file, settings) if settings else file
    else:
        file = options.load_vehicle(vehicle, settings)
        named = options.naming(file, folder)
    by = recorded.metadata.get("backend", "auto") if backend == "auto" else backend
    own = file.estimator(options.own_block(file, "estimator", estimator))
    path = options.run_path(out, folder, f"replay-{recorded.name}")
    with clocked(note("cli.replay"), recorded.duration_s) as progress:
        again = replay(
            recorded,
            file,
            estimator=own,
            path=None if smooth else path,
            observers=(Progress(progress),),
            backend=by,
        )
    if smooth:
        again = replace(smoothed(again, file, own, initial_pose(recorded), backend), name=path.stem)
        write_run(again, path)
    talk(note("cli.run", path=path))
    several = [recorded, again] if recorded.estimate is not None else [again]
    compared = compare(several, alignment=align)
    answer(compared, as_json)
    options.advise_to_fit(compared, [recorded] * len(several), named, folder)
    if page is not None:
        from baqueano.report.of_run import page_of_run

        beside = recorded if recorded.estimate is not None else None
        talk(note("cli.report", page=page_of_run(again, align, beside).save(page)))
    if shown:
        live.show_both(path, recorded.path, folder)
    if not _same(stop_of(again), stop_of(recorded)):  # a stop that was recorded is replayed with the rest
        options.ended(again, path)
    else:
        options.warned(again)


def _same(stop: "Diagnostic | None", recorded: "Diagnostic | None") -> bool:
    """Return True where both stops say the same; one that was recorded before there were codes has its words alone."""
    from baqueano.messages import text

    return stop == recorded or text(stop) == text(recorded)
