"""Lines to type: a command with its words quoted as the shell of this system reads them."""

import os
import shlex
import subprocess


def typed(*words: object) -> str:
    """Return a command of baqueano as one types it.

    >>> typed("runs", "show", "my runs/0001.mcap")
    "baqueano runs show 'my runs/0001.mcap'"
    """
    line = ["baqueano", *map(str, words)]
    return subprocess.list2cmdline(line) if os.name == "nt" else shlex.join(line)
