"""Represent the checks of a vehicle: each has a result, a verdict and a remedy. The verdicts are:

ok        the result is as expected
warn      the vehicle drives, but worse than it could
bad       the vehicle does not drive, or not safely
unknown   this machine cannot make the check; the result states why
"""

from dataclasses import dataclass, field
from typing import NamedTuple

from baqueano.contracts.values import TableRow
from baqueano.messages.language import translate as _
from baqueano.messages.printable import join_rows
from baqueano.messages.text_table import text_table


class Check(NamedTuple):
    """A check of the vehicle: its name, its verdict, the measured result as text, and a remedy."""

    name: str
    verdict: str
    figure: str
    remedy: str = ""


@dataclass
class Report:
    """The checks of a vehicle, and the verdict on all of them."""

    checks: list[Check] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """Return the most severe verdict: "bad", "warn" or "ok". "unknown" has the weight of "ok"."""
        verdicts = {check.verdict for check in self.checks}
        return "bad" if "bad" in verdicts else "warn" if "warn" in verdicts else "ok"

    def rows(self) -> list[TableRow]:
        """Return a row for each check."""
        return [check._asdict() for check in self.checks]

    def table(self) -> str:
        """Return a line of text for each check, with its remedy below it unless the verdict is "ok"."""
        lines = []
        for check in self.checks:
            lines.append((_(check.verdict), _(check.name), check.figure))
            if check.remedy and check.verdict != "ok":
                lines.append(("", "", f"→ {check.remedy}"))
        return join_rows(
            [*text_table("<<<", *lines), _("overall result: {verdict}", verdict=_(self.verdict))]
        )
