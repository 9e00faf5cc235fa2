"""baqueano demo."""

import shutil
import sys
from itertools import count
from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import answer, busy, steps, talk
from baqueano.diagnostics import note


def typed_here() -> str:
    """Return the name of this program in this shell: its path, where `make` has hidden it from the shell."""
    if shutil.which("baqueano") or not (own := Path(sys.argv[0])).is_file():
        return "baqueano"
    return str(own)


def free_folder() -> Path:
    """demo, or the first of demo-2, demo-3, … that is not there: what an earlier demo made is kept."""
    names = (Path("demo" if k == 1 else f"demo-{k}") for k in count(1))
    return next(path for path in names if not path.exists())


@click.command(help="The whole loop on the simulated small vehicle: identify, tune, teach, repeat, report.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    help="A folder; default: demo, or the next that is free, demo-2.",
)
@click.option(
    "--page/--no-page", "shown", default=None,
    help="Show the drives in a browser, in motion. Default: where there is a display.",
)  # fmt: skip
@click.option(
    "--pace", type=click.FloatRange(0.05, 50.0), default=4.0, show_default=True,
    help="Simulated seconds that the page shows in a second.",
)  # fmt: skip
@click.option(
    "--animation",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.svg",
    help="Also write fit and drive as a moving picture.",
)
@options.seed
@options.backend
@options.as_json
def command(
    out: Path | None,
    shown: bool | None,
    pace: float,
    animation: Path | None,
    seed: int,
    backend: str,
    as_json: bool,
) -> None:
    from baqueano.cli.page.motion import in_motion
    from baqueano.report.animation import picture_file
    from baqueano.report.page import save_text
    from baqueano.study.demo import demo

    moves = None if animation is None else picture_file(animation)
    out = out or free_folder()
    with in_motion(out, shown, pace) as motion:
        with steps() as begin:
            found = demo(out, seed, backend, begin, motion.show, motion.tuned)
        answer(found, as_json)
        with busy(note("cli.drawing")):
            page = found.page().save(out / "report.html")
            if moves is not None:
                save_text(moves, found.animation(backend))
        motion.say(note("web.demo-done", verdict=str(found.verdict)))
    talk(note("cli.demo", page=page, program=typed_here()))
