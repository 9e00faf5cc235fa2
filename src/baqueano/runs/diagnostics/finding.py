"""Represent a finding about a recording."""

from typing import NamedTuple

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.messages import text
from baqueano.messages.language import mark as N_

KIND_CODES = (  # codes as words; `accept` in a map takes them in English
    N_("constant"), N_("repeated samples"), N_("gyro at rest"), N_("fast turns"), N_("counts per g"),
    N_("quiet accelerometer"), N_("curve"),
    N_("command range"), N_("inverted"), N_("swapped"), N_("unit"), N_("scale"), N_("no sign"), N_("unrelated"),
    N_("clock"), N_("track"), N_("sign"), N_("mirrored"), N_("heading offset"), N_("repeats"), N_("gap"),
    N_("time jump"), N_("time unit"), N_("time steps back"), N_("short"), N_("no command yet"), N_("no command"),
    N_("missing"), N_("no time"), N_("cut line"), N_("not in all files"), N_("counter overflow"),
    N_("full scale"), N_("axes"), N_("counter"), N_("joined rows"),
)  # fmt: skip


class ImportFinding(NamedTuple):
    """A finding about a recording. Its sentences are stored as data, and translated when they are read."""

    code: str  # the name for `accept` in the map
    level: str  # "error": contradicts the map; "warning": corrected or excluded; "info": only reported
    reason: Diagnostic
    line: Diagnostic | str | None = None  # the line to write in the map
    t_ns: int | None = None  # beginning of the finding; None: it concerns the whole recording
    usual: bool = False  # every import with this kind of map has this finding

    @property
    def text(self) -> str:
        """Return the reason as a sentence."""
        return text(self.reason)

    @property
    def line_text(self) -> str:
        """Return the line to write in the map, "" without such a line."""
        return text(self.line)

    @property
    def diagnostic(self) -> Diagnostic:
        """Return the reason and the line to write as one diagnostic."""
        severity = Severity(self.level)
        if self.line is None:
            return note("recording.cause", severity, finding=self.code, cause=self.reason)
        return note(
            "recording.finding-and-line", severity, finding=self.code, cause=self.reason, line=self.line
        )

    @property
    def advice(self) -> str:
        """Return the reason as a sentence, followed by the line to write, if any."""
        return f"{self.text}; {self.line_text}" if self.line else self.text
