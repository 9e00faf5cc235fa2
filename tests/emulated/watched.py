"""`python watched.py -m baqueano …` runs this process and records its imported modules in the file $MODULE_LOG.

One JSON line at READY=1 lists all modules. One line at the end of each drive lists the modules that were imported
between its first and its last tick.
"""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from baqueano.cli import main
from baqueano.robot.service.realtime import Systemd


def write_line(**modules: Any) -> None:
    """Write a line."""
    with Path(os.environ["MODULE_LOG"]).open("a", encoding="utf-8") as out:
        out.write(json.dumps({name: sorted(names) for name, names in modules.items()}) + "\n")


def watch_start() -> None:
    """Record the modules at READY=1, and from then on those of each drive."""
    notify = Systemd.notify

    def notify_and_watch(self: Systemd, words: str) -> None:
        if words == "READY=1":
            write_line(ready=sys.modules)
            watch_ticks()
        notify(self, words)

    Systemd.notify = notify_and_watch


def watch_ticks() -> None:
    """Record the modules at the end of each drive."""
    from baqueano.robot.service.service import Service

    ticks = Service._ticks

    def ticks_and_watch(self: Service, *arguments: Any) -> Iterator[int]:
        first, rest_names = set[str](), set[str]()
        try:
            for t_ns in ticks(self, *arguments):
                first = first or set(sys.modules)
                rest_names = set(sys.modules) - first
                yield t_ns
        finally:
            if first:  # the drive has begun
                write_line(late=rest_names)

    Service._ticks = ticks_and_watch


watch_start()
main(sys.argv[3:])
