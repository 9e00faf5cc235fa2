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
def command(run: str, align: str, folder: str, out: Path | None) -> None:
    from baqueano.report.of_run import page_of_run

    found = options.find_runs((run,), folder)[0]
    with busy(note("cli.drawing")):
        page = page_of_run(found, align).save(out if out is not None else Path(f"{found.name}.html"))
    tell(str(page))
