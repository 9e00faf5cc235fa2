"""baqueano report."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import busy, tell
from baqueano.diagnostics import note


@click.command(help="Write one self-contained HTML page about RUN.")
@click.argument("run", default="last")
@click.option("--align", type=click.Choice(["none", "start", "rigid"]), default="none", show_default=True,
              help="How the estimated path is laid on the true one.")  # fmt: skip
@options.runs_folder
@click.option("-o", "--out", type=click.Path(path_type=Path), help="Default: NAME.html.")
@click.option(
    "--figures",
    type=click.Path(path_type=Path, file_okay=False),
    help="A folder: also write each figure as a file of its own.",
)
@click.option(
    "--format", "file_format", type=click.Choice(["svg", "pdf", "png"]), default="svg", show_default=True,
    help="Of these figures.",
)  # fmt: skip
@click.option(
    "--width", metavar="column|page|MM", help="Of these figures: of a column, of a page, or in millimetres."
)
@click.option(
    "--animation",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.svg",
    help="Also write the run as a moving picture, for a page or a talk.",
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
    from baqueano.report import report
    from baqueano.report.animation import picture_file
    from baqueano.report.animation.picture import animation as moving_picture
    from baqueano.report.animation.scene import scene
    from baqueano.report.page import save_text

    moves = None if animation is None else picture_file(animation)

    found = options.find_runs((run,), folder)[0]
    with busy(note("cli.drawing")):
        path = out if out is not None else Path(f"{found.name}.html")
        page = report(found, path, alignment=align)
        files = [] if figures is None else page.save_figures(figures, file_format, _width(width))
        if moves is not None:
            files.append(save_text(moves, moving_picture(scene(found))))
    for written in (path, *files):
        tell(str(written))


def _width(said: str | None) -> str | float | None:
    """A name, or a number of millimetres."""
    try:
        return None if said is None else float(said)
    except ValueError:
        return said
