"""Represent a Raspberry Pi below its root, the record of its former state, and a change that can be undone.

This module uses only the standard library: for the vehicle, install.py puts this text before the text of steps.py.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject

ACCOUNT = "baqueano"  # the account of the service, without login and sudo
WORDS: dict[str, str] = {}  # English → the language of the laptop; filled by install.py


class Step(NamedTuple):
    """A change: `done` tests if it is made, `do` makes it, `undo` restores the former state that `do` recorded.

    That state is recorded under `key`. A step without a record is not undone.
    """

    name: str
    done: Callable[[], bool]
    do: Callable[[], object] = lambda: None
    key: str = ""
    undo: Callable[[], object] = lambda: None


class Pi:
    """The machine below `root`, and the record of its changes. Raise SystemExit if the record is damaged."""

    def __init__(self, root: Path, bundle: Path, user: str, run: Callable[..., str] | None = None) -> None:
        self.root, self.bundle, self.user = root, bundle, user
        self.run = run or command_output
        self.state_path = self.target_path("etc/baqueano/setup.json")
        try:
            self.stored_state: JsonObject = json.loads(read_text(self.state_path) or "{}")
        except ValueError as error:
            message = _(
                "{path} is damaged ({error}): the former state of this machine is lost. Type on the vehicle sudo mv "
                "{path} {path}.damaged, and then set it up again",
                path=self.state_path, error=error,
            )  # fmt: skip
            sys.exit(message)

    def target_path(self, path: str) -> Path:
        """Return the path `path` of the machine, below `root`."""
        return self.root / path.lstrip("/")

    def record_state(self, name: str, value: object) -> None:
        """Record the former state `value` under `name`, unless it is recorded already.

        New entries of a list are appended to the recorded list. None deletes the record.
        """
        if value is None:
            self.stored_state.pop(name, None)
        elif isinstance(value, list):
            self.stored_state[name] = list(dict.fromkeys([*self.stored_state.get(name, []), *value]))
        else:
            self.stored_state.setdefault(name, value)
        if not self.stored_state:
            self.state_path.unlink(missing_ok=True)
            with suppress(OSError):  # a damaged record can still be there
                self.state_path.parent.rmdir()
            return
        self.state_path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self.state_path, json.dumps(self.stored_state, indent=1))

    @property
    def config(self) -> Path:
        """Return the path of config.txt, which is in boot/firmware or, on old images, in boot."""
        former_config = self.target_path("boot/config.txt")
        if former_config.exists() and not self.target_path("boot/firmware/config.txt").exists():
            return former_config
        return self.target_path("boot/firmware/config.txt")

    def group_members(self, *names: str) -> dict[str, list[str]]:
        """Return the members of each group in `names`, without groups that do not exist on the machine."""
        fields = [line.split(":") for line in read_text(self.target_path("etc/group")).splitlines()]
        members = {f[0]: f[3].split(",") for f in fields if len(f) == 4}
        return {group: members[group] for group in names if group in members}

    def account_fields(self) -> list[str] | None:
        """Return the fields of the service's account in /etc/passwd; None if the account does not exist."""
        lines = [line.split(":") for line in read_text(self.target_path("etc/passwd")).splitlines()]
        return next((fields for fields in lines if fields[0] == ACCOUNT and len(fields) == 7), None)

    @property
    def venv(self) -> Path:
        """Return the path of the Python environment of the service."""
        return self.target_path("opt/baqueano")


def read_text(path: Path) -> str:
    """Return the text of a file, "" if it does not exist."""
    return path.read_text(encoding="utf-8") if path.exists() else ""


def _(words: str, /, **figures: object) -> str:
    """Return the words, with the figures inserted, in the language of the user of `robot setup`."""
    return WORDS.get(words, words).format_map(figures)


def write_atomically(path: Path, text: str) -> None:
    """Write the text to a new file, which then replaces the old file, so that a power cut leaves a complete file."""
    replace_entry(path.resolve(), text.encode())


def replace_entry(path: Path, content: bytes) -> None:
    """Replace the entry `path` of a folder, even a link, by a complete file; nothing is written through a link."""
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    with part.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, path)


def command_output(*command: str) -> str:
    """Return the output of a command. Raise SystemExit, with the command's message, if the command fails."""
    process = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
    if process.returncode:
        output, line = (process.stderr or process.stdout).strip()[-2000:], " ".join(command)
        sys.exit(_("{command} failed ({code}): {words}", command=line, code=process.returncode, words=output))
    return process.stdout
