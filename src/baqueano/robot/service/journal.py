"""Keep a file during a mission: if a service finds the file at its start, the previous service ended in a drive.

A block can end the process of the service by os._exit or by a crash in C. It can also catch every alarm in a loop,
until systemd's watchdog ends the process. Then the process can no longer report the cause. The firmware's dead-man
timer stops the motors, systemd starts the service again, and the new service reads from this file which mission was
driven. Python also writes a traceback into the file if the process ends by a signal that allows a traceback (a crash,
the watchdog).
"""

import faulthandler
import json
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.drive.mission import Mission

JOURNAL_NAME = "mission.journal"
BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")
USER_BLOCK = re.compile(r'"([^"\n]+\.py:\w+)"')
TRACE_FRAME = re.compile(r'  File "[^"\n]*?([^"/\n]+)", line (\d+)')


class Journal:
    """The journal file, in the folder of the runs."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / JOURNAL_NAME
        self._traces: Any = None  # the same file, open for the tracebacks of Python

    def begin(self, mission: Mission, run: str) -> None:
        """Write the mission and the run that begin; do nothing if the file cannot be written."""
        kinds = dict.fromkeys([*mission.blocks.values(), *USER_BLOCK.findall(mission.vehicle)])
        block_names = (
            ", ".join(kind for kind in kinds if kind.partition(":")[0] in mission.texts) or "our blocks"
        )
        entry = {
            "boot": _boot_id(),
            "kind": mission.kind,
            "run": run,
            "blocks": block_names,
            "texts": [*mission.texts],
        }
        with suppress(OSError, ValueError):
            self.path.write_text(json.dumps(entry) + "\n", encoding="utf-8")
            if not faulthandler.is_enabled():
                self._traces = self.path.open("a", encoding="utf-8")
                faulthandler.enable(self._traces, all_threads=False)

    def end(self) -> None:
        """Delete the file: the mission is over, and its end was reported."""
        if self._traces is not None:
            faulthandler.disable()
            self._traces.close()
            self._traces = None
        with suppress(OSError):
            self.path.unlink(missing_ok=True)

    def unfinished_mission(self) -> Diagnostic | None:
        """Return the mission that was driven when the previous service ended; None if no mission was driven.

        Return None also for a damaged file, or if the computer was started again since then, as after a power cut.
        """
        try:
            entry_text, _, trace = self.path.read_text(encoding="utf-8", errors="replace").partition("\n")
            entry = json.loads(entry_text)
            values = {name: str(entry[name]) for name in ("kind", "run", "blocks")}
            boot, texts = entry["boot"], [str(name) for name in entry["texts"]]
        except (OSError, ValueError, KeyError, TypeError, RecursionError):  # none, or damaged by a power cut
            return None
        if boot != _boot_id():
            return None
        user_frames = [(name, int(line)) for name, line in TRACE_FRAME.findall(trace) if name in texts]
        file_name, line = user_frames[0] if user_frames else ("", 0)
        code = StopReason.MISSION_UNFINISHED_AT if user_frames else StopReason.MISSION_UNFINISHED
        return stop(code, **values, file=file_name, line=line)


def _boot_id() -> str:
    """Return the id of the present boot of the computer; "" if the system does not provide it."""
    try:
        return BOOT_ID_FILE.read_text(encoding="ascii").strip()
    except OSError:
        return ""
