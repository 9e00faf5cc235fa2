"""Define options of the subcommands that open the page, and the functions that run it."""

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING

import click

from baqueano.cli import numbers, options
from baqueano.cli.page.live import require_websockets

if TYPE_CHECKING:
    from baqueano.web.run import PageOptions

server_options = options.combine_options(
    click.option("--port", type=numbers.WholeNumber(0, 65535), default=0, help=("Port of the page; "
                                                                          "default: a free one.")),
    click.option(
        "--share", is_flag=True,
        help=(
            "Also share the page in this network; others need the printed address or its QR code. Default: "
            "this computer only."
        ),
    ),
    click.option("--address", default="", metavar="IP", help=(
        "Address to share; default: the address of this computer in the network."
    )),
    click.option("--browser/--no-browser", default=True, help="Open a browser tab, if there is a display."),
)  # fmt: skip


def serve_options(folder: str, port: int, share: bool, address: str, browser: bool) -> "PageOptions":
    """Return the options of the page. Raise UsageError if the library of the page is missing."""
    require_websockets()
    from baqueano.web.run import PageOptions

    return PageOptions(Path(folder), port, share or bool(address), address, browser)


def run(page: Coroutine[None, None, None]) -> None:
    """Run the coroutine of a page until it ends."""
    asyncio.run(page)
