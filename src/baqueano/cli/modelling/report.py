"""Define `baqueano report`: write an HTML page about a run."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import print_result, show_activity
from baqueano.diagnostics import fault, note
from baqueano.messages.printable import baqueano_command


@click.command(help="Write one self-contained HTML page about RUN.")
@click.argument("run", default="last")
@click.option("--align", type=click.Choice(["none", "start", "rigid"]), default="none", show_default=True,
              help="Alignment of the estimated path with the true path.")  # fmt: skip
@options.runs_folder
@click.option("-o", "--out", type=click.Path(path_type=Path), help="Page to write; default: NAME.html.")
@click.option(
    "--figures",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder: also write each figure as a separate file.",
)
@click.option(
    "--format", "file_format", type=click.Choice(["svg", "pdf", "png"]), default="svg", show_default=True,
    help="Format of these figures.",
)  # fmt: skip
@click.option(
    "--width", metavar="column|page|MM", help="Width of these figures: column, page, or millimetres."
)
@click.option(
    "--animation",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.svg",
    help="Also write the run as an animated picture, for a page or a talk.",
)
def command(
    run: str,
    align: str,
    folder: str,
    out: Path | None,
    figures: Path | None,
    file_format: str,
    width: str | None,
    animation: Path | None,
) -> None:
    from baqueano.errors import UsageError
    from baqueano.report import report
    from baqueano.report.animation import picture_file
    from baqueano.report.animation.picture import animation as moving_picture
    from baqueano.report.animation.scene import scene
    from baqueano.report.page import save_text

    mm = _width(width)
    if mm is not None and figures is None:
        correction = baqueano_command("report", run, "--figures", "figures", "--width", width)
        raise UsageError(fault("cli.width-unused", correction, width=width))
    picture_path = None if animation is None else picture_file(animation)

    loaded_run = options.find_runs((run,), folder)[0]
    with show_activity(note("cli.drawing")):
        path = out if out is not None else Path(f"{loaded_run.name}.html")
        page = report(loaded_run, path, alignment=align)
        files = [] if figures is None else page.save_figures(figures, file_format, mm)
        if picture_path is not None:
            files.append(save_text(picture_path, moving_picture(scene(loaded_run))))
    for saved_path in (path, *files):
        print_result(str(saved_path))


def _width(argument: str | None) -> str | float | None:
    """Return a width as a name or as a number of millimetres. Raise UsageError for an invalid width."""
    if argument is None:
        return None
    from baqueano.report.canvas import width_mm

    try:
        width: str | float = float(argument)
    except ValueError:
        width = argument
    width_mm(width)
    return width
