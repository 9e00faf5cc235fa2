"""A finding about a recording."""

from typing import NamedTuple

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.messages import text


class Doubt(NamedTuple):
    """A finding about a recording; its sentences are data, in the language of their reader."""

    code: str  # as `accept` in the map names it
    level: str  # "error" contradicts the map, "warning" was dealt with, "info" is good to know
    t_ns: int | None  # where it begins; None: everywhere
    why: Diagnostic
    line: Diagnostic | None = None  # to write in the map
    usual: bool = False  # every import of such a map has it

    @property
    def text(self) -> str:
        """Return the sentence."""
        return text(self.why)

    @property
    def cure(self) -> str:
        """Return the line to write in the map."""
        return text(self.line)

    @property
    def diagnostic(self) -> Diagnostic:
        """Return the sentence and the line to write, as one."""
        severity = Severity(self.level)
        if self.line is None:
            return note("doubt.alone", severity, what=self.code, cause=self.why)
        return note("doubt.with-line", severity, what=self.code, cause=self.why, line=self.line)

    @property
    def advice(self) -> str:
        """Return the text, and the line to write."""
        return f"{self.text}; {self.cure}" if self.line else self.text
