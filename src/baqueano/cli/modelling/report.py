"""Define `baqueano report`: write an HTML page about a run."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.report_files import ReportFiles, figure_options
from baqueano.cli.terminal import print_result, show_activity
from baqueano.diagnostics import note


@click.command(help="Write one self-contained HTML page about RUN.")
@click.argument("run", default="last")
@options.align
@options.runs_folder
@click.option("-o", "--out", type=click.Path(path_type=Path), help="Page to write; default: NAME.html.")
@figure_options
@click.option(
    "--animation",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.svg",
    help="Also write the run as an animated picture, for a page or a talk.",
)
def command(
    run: str, align: str, folder: str, out: Path | None, report: ReportFiles, animation: Path | None
) -> None:
    from baqueano.report.animation import picture_file
    from baqueano.report.animation.picture import animation as moving_picture
    from baqueano.report.animation.scene import scene
    from baqueano.report.page import save_text
    from baqueano.report.run_report import run_page

    picture_path = None if animation is None else picture_file(animation)

    loaded_run = options.find_runs((run,), folder)[0]
    with show_activity(note("cli.drawing")):
        files = report.save(run_page(loaded_run, align), out or Path(f"{loaded_run.name}.html"))
        if picture_path is not None:
            files.append(save_text(picture_path, moving_picture(scene(loaded_run))))
    for saved_path in files:
        print_result(str(saved_path))
