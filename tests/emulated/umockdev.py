"""A machine for other processes: umockdev answers their calls to device files, and a server emulates the devices."""

import json
import os
import subprocess
import sys
from pathlib import Path

SYSTEM_PYTHON = "/usr/bin/python3"
PATIENCE_S = 60.0  # timeout of a silent process


class Machine:
    """A machine with the devices that `server`, a script beside this file, makes of its argument."""

    def __init__(self, server: str, argument: object) -> None:
        script = str(Path(__file__).with_name(server))
        self._server = subprocess.Popen(
            [SYSTEM_PYTHON, script, json.dumps(argument)], stdin=-1, stdout=-1, text=True
        )
        root = json.loads(self._server.stdout.readline())["root"]
        self.environment = {"UMOCKDEV_DIR": root, "LD_PRELOAD": "libumockdev-preload.so.0"}

    def order(self, *words):
        """Change the state of the devices and return the answer of the server."""
        self._server.stdin.write(json.dumps(words) + "\n")
        self._server.stdin.flush()
        return json.loads(self._server.stdout.readline())

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a program on this machine to its end."""
        return subprocess.run(
            command, env={**os.environ, **self.environment}, capture_output=True, text=True, timeout=PATIENCE_S,
            check=False,
        )  # fmt: skip

    def python(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run Python on this machine to its end."""
        return self.run(sys.executable, *command)

    def close(self) -> None:
        self._server.communicate(json.dumps(["quit"]) + "\n", timeout=PATIENCE_S)
