"""baqueano compare."""

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import answer, talk
from baqueano.diagnostics import note
from baqueano.printable import typed


@click.command(help="Errors and consistency of one or more RUNS: by number, name, path, or 'last'.")
@click.argument("runs", nargs=-1, required=True)
@click.option("--align", type=click.Choice(["none", "start", "rigid"]), default="none", show_default=True,
              help="How the estimated path is laid on the true one.")  # fmt: skip
@click.option("--skip", "skip_s", type=numbers.moment, default=0.0, help="Seconds to leave out at the start.")
@options.runs_folder
@options.as_json
def command(runs: tuple[str, ...], align: str, skip_s: float, folder: str, as_json: bool) -> None:
    from baqueano.compare import compare

    found = options.find_runs(runs, folder)
    compared, named = compare(found, alignment=align, skip_s=skip_s), options.naming_own(folder)
    answer(compared, as_json)
    options.advise_to_fit(compared, found, named, folder)
    if (without := [run for run in found if run.estimate is None]) and not as_json:
        name = without[0].path or without[0].name
        talk(note("cli.no-estimate", fix=typed("replay", name, *named), run=without[0].name))
