"""Define `baqueano demo`: show the whole method on the simulated small vehicle."""

import shutil
import sys
from itertools import count
from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.report_files import ReportFiles, figure_options
from baqueano.cli.terminal import print_answer, print_message, show_activity, show_steps
from baqueano.diagnostics import Diagnostic, note
from baqueano.messages.printable import shell_command


def program_name() -> str:
    """Return the command that a user types to start this program: its name, or its path if the shell does not
    find the name. A package that was started as a module has the name of the interpreter before it."""
    if shutil.which("baqueano") or not (program_path := Path(sys.argv[0])).is_file():
        return "baqueano"
    if program_path.name == "__main__.py":
        return shell_command(sys.executable, "-m", "baqueano")
    return shell_command(program_path)


def unused_folder() -> Path:
    """Return the first folder of demo, demo-2, demo-3, … that does not exist, so that earlier demos are kept."""
    names = (Path("demo" if k == 1 else f"demo-{k}") for k in count(1))
    return next(path for path in names if not path.exists())


def _picture_file(path: Path) -> Path:
    from baqueano.report.animation import picture_file

    return picture_file(path)


@click.command(
    help="Run the whole loop on the simulated small vehicle: identify, tune, teach, repeat, report."
)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to write; default: demo, or the next free name, demo-2.",
)
@click.option(
    "--page/--no-page", "show_page", default=None,
    help="Show the drives in a browser while they happen. Default: if there is a display.",
)  # fmt: skip
@click.option(
    "--pace", type=numbers.pace, default=4.0, show_default=True,
    help="Simulated seconds per real second, on the page.",
)  # fmt: skip
@click.option(
    "--animation",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.svg",
    help="Also write the fit and the drive as an animated picture.",
)
@figure_options
@options.seed
@options.backend
@options.as_json
def command(
    out: Path | None,
    show_page: bool | None,
    pace: float,
    animation: Path | None,
    report: ReportFiles,
    seed: int,
    backend: str,
    as_json: bool,
) -> None:
    from baqueano.cli.page.playback import run_with_page

    picture_path = None if animation is None else _picture_file(animation)
    out = out or unused_folder()
    with run_with_page(out, show_page, pace) as motion:
        from baqueano.report.page import save_text  # these modules are loaded while the page starts
        from baqueano.study.demo import demo

        motion.wait_until_served()
        with show_steps() as begin:

            def begin_step(step: Diagnostic) -> object:
                motion.show_step(step)
                return begin(step)

            result = demo(out, seed, backend, begin_step, motion.show, motion.show_tuning)
        print_answer(result, as_json)
        report.write(result.page, out / "report.html")
        if picture_path is not None:
            with show_activity(note("cli.drawing")):
                save_text(picture_path, result.animation(backend))
        motion.show_event(note("web.demo-done", verdict=str(result.verdict)))
    print_message(note("cli.demo", program=program_name()))
