"""baqueano demo."""

import shutil
import sys
from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import answer, busy, steps, talk


def typed_here() -> str:
    """How this program is called in this shell: by its path, where `make` has put it out of the shell's sight."""
    if shutil.which("baqueano") or not (own := Path(sys.argv[0])).is_file():
        return "baqueano"
    return str(own)


@click.command(help="The whole loop on the simulated small vehicle: identify, tune, teach, repeat, report.")
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("demo"), show_default=True, help="A folder."
)
@options.seed
@options.backend
@options.as_json
def command(out: Path, seed: int, backend: str, as_json: bool) -> None:
    from baqueano.study.demo import demo

    with steps() as begin:
        found = demo(out, seed, backend, begin)
    answer(found, as_json)
    with busy("drawing the figures"):
        page = found.page().save(out / "report.html")
    talk(f"\nreport: {page}   runs, route and vehicle file beside it\nnext:   {typed_here()} new mylab")
