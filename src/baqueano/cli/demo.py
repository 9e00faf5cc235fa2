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
@options.seed
@options.backend
@options.as_json
def command(out: Path | None, seed: int, backend: str, as_json: bool) -> None:
    from baqueano.study.demo import demo

    out = out or free_folder()
    with steps() as begin:
        found = demo(out, seed, backend, begin)
    answer(found, as_json)
    with busy(note("cli.drawing")):
        page = found.page().save(out / "report.html")
    talk(note("cli.demo", page=page, program=typed_here()))
