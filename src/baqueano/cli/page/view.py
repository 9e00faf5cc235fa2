"""Define `baqueano view`: open a run in a browser."""

import click

from baqueano.cli import options
from baqueano.cli.page import options as page_options
from baqueano.cli.terminal import print_message


@click.command(help="Open RUN in a browser: map, time plots, events; compare it with another run.")
@click.argument("run", default="last")
@click.option("--ghost", metavar="RUN", help="A second run, drawn next to the first.")
@options.runs_folder
@page_options.server_options
def command(
    run: str, ghost: str | None, folder: str, port: int, share: bool, address: str, browser: bool
) -> None:
    serve_options = page_options.serve_options(folder, port, share, address, browser)
    from baqueano.web.run import show_runs

    page_options.run(show_runs((run, ghost) if ghost else (run,), serve_options, print_message))
