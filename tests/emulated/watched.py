"""`python watched.py -m baqueano …` is that process, and tells which modules it had when: into the file $WATCHED.

A line of JSON at READY=1 with those that are there, and one at the end of each drive with those that were imported
between its first tick and its last.
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
    """A line."""
    with Path(os.environ["WATCHED"]).open("a", encoding="utf-8") as out:
        out.write(json.dumps({name: sorted(names) for name, names in modules.items()}) + "\n")


def watch_start() -> None:
    """Tells at READY=1, and from then on of drives."""
    say = Systemd.say

    def say_and_watch(self: Systemd, words: str) -> None:
        if words == "READY=1":
            write_line(ready=sys.modules)
            watch_ticks()
        say(self, words)

    Systemd.say = say_and_watch


def watch_ticks() -> None:
    """Tells at the end of each drive."""
    from baqueano.robot.service.service import Service

    ticks = Service._ticks

    def ticks_and_watch(self: Service, *arguments: Any) -> Iterator[int]:
        first, late = set[str](), set[str]()
        try:
            for t_ns in ticks(self, *arguments):
                first = first or set(sys.modules)
                late = set(sys.modules) - first
                yield t_ns
        finally:
            if first:  # it began
                write_line(late=late)

    Service._ticks = ticks_and_watch


watch_start()
main(sys.argv[3:])
