"""`python -m baqueano.cli.page.attached FOLDER`: serve a page over pipes for the program that started it."""

import argparse
import asyncio
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from baqueano.diagnostics import Diagnostic
from baqueano.errors import BaqueanoError
from baqueano.messages import text
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.web.run import PageOptions, show_vehicle
from baqueano.web.service import ServiceLink, pipe_link

POLL_S = 0.05  # between two counts of the viewers


async def serve(options: PageOptions) -> None:
    """Serve the drives of a subcommand until it closes its end of the pipes, and report the number of viewers."""
    link: list[ServiceLink] = []
    viewers: list[Callable[[], int]] = []
    count_tasks: list[asyncio.Task[None]] = []

    async def start() -> ServiceLink:
        link.append(await pipe_link(sys.stdin.buffer, sys.stdout.buffer))
        return link[0]

    def print_message(message: Diagnostic | str) -> None:
        print(text(message), file=sys.stderr, flush=True)
        if isinstance(message, Diagnostic) and message.code == "web.address":
            count_tasks.append(asyncio.get_running_loop().create_task(count()))

    async def count() -> None:
        former_count = -1
        with suppress(BaqueanoError):
            while True:
                if (viewer_count := viewers[0]()) != former_count:
                    former_count = viewer_count
                    link[0].send("viewers", count=viewer_count)
                await asyncio.sleep(POLL_S)

    try:
        await show_vehicle(start, options, print_message, lasting=False, meet=viewers.append)
    finally:
        for task in count_tasks:
            task.cancel()


def main() -> int:
    """Run the page; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m baqueano.cli.page.attached", description=__doc__)
    parser.add_argument("folder", type=Path, help="the folder of the runs")
    try:
        with use_notation(COMMAND_LINE):
            asyncio.run(serve(PageOptions(parser.parse_args().folder)))
    except BaqueanoError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
