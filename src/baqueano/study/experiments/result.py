"""Result of `study experiments`: each signal on the vehicles of each file and room, and on all vehicles."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import TableRow
from baqueano.design.information import mean_error
from baqueano.diagnostics import Verdict
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table

DESIGNED, BASELINE = "designed", "random_steps"
MIN_RATIO = 1.5


class ExperimentRow(NamedTuple):
    """The results of a signal on the vehicles of one file, or of all files."""

    vehicle: str
    room: str
    signal: str
    mean_error: float  # geometric mean over vehicles and parameters
    ratio: float  # error of random steps divided by the error of this signal
    above_best: int  # vehicles for which the best other signal is more informative
    vehicles: int
    left: int  # drives in which the body left the room
    drives: int
    nearest_m: float  # least distance of a body to a wall, over all drives
    seconds: float  # planning time, the longest


@dataclass(frozen=True, slots=True, eq=False)
class Experiments:
    """The table of `study experiments`, with its verdict."""

    signal_rows: tuple[ExperimentRow, ...]
    duration_s: float

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each requirement that is missed."""
        reasons = []
        design = next(r for r in self.signal_rows if (r.vehicle, r.signal) == ("all", DESIGNED))
        if design.ratio < MIN_RATIO:
            reasons.append(
                _(
                    "the designed signal is {ratio:.2f} times better than random steps; expected "
                    "{expected:g} times",
                    ratio=design.ratio,
                    expected=MIN_RATIO,
                )
            )
        if designs := design.above_best:
            reasons.append(_("for {above} vehicles another signal gives more information", above=designs))
        exits = sum(row.left for row in self.signal_rows if row.vehicle != "all")
        if exits:
            reasons.append(_("in {left} drives the body left the room", left=exits))
        if design.seconds > self.duration_s / 6.0:
            figures = {"seconds": design.seconds, "duration_s": self.duration_s}
            reasons.append(
                _("the design took {seconds:.1f} s, more than a sixth of {duration_s:g} s", **figures)
            )
        return tuple(reasons)

    @property
    def verdict(self) -> Verdict:
        """Return WARN if there are reasons, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return a flat row per file and signal."""
        return [row._asdict() for row in self.signal_rows]

    def table(self) -> str:
        """Return the rows and reasons as a text table."""
        head = [
            _("vehicles"), _("room"), _("signal"), _("mean error"), _("better"), _("above best"), _("outside"),
            _("nearest"), _("made in"),
        ]  # fmt: skip
        rows = (
            [_(r.vehicle), r.room, _(r.signal), f"{number(100.0 * r.mean_error):.4f} %", f"{number(r.ratio):.2f}×",
             f"{r.above_best} / {r.vehicles}", f"{r.left} / {r.drives}", f"{number(100.0 * r.nearest_m):.0f} cm",
             f"{number(r.seconds):.1f} s"]
            for r in self.signal_rows
        )  # fmt: skip
        lines = text_table("<<<>>>>>>", head, *rows)
        return "\n".join([*lines, *(f"! {reason}" for reason in self.reasons)])


class SignalErrors(NamedTuple):
    """Errors and margins of one signal on the vehicles of one file in one room."""

    errors: np.ndarray  # (V,)
    margins: np.ndarray  # (V · DRIVES,) [m]
    seconds: float


def experiment_rows(vehicle: str, size: str, draws: dict[str, SignalErrors]) -> list[ExperimentRow]:
    """Return a row for each signal on the vehicles of one file and room."""
    base = mean_error(draws[BASELINE].errors)
    rows = []
    for signal, drive in draws.items():
        rival_errors = np.min([d.errors for s, d in draws.items() if s != signal], axis=0)
        error = mean_error(drive.errors)
        rows.append(
            ExperimentRow(
                vehicle, size, signal, error, base / error, int(np.sum(drive.errors > rival_errors)), len(drive.errors),
                int(np.sum(drive.margins < 0.0)), len(drive.margins), float(drive.margins.min()), drive.seconds,
            )
        )  # fmt: skip
    return rows


def merge(parts: list[SignalErrors]) -> SignalErrors:
    """Return the results of a signal on the vehicles of all parts."""
    errors, margins = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return SignalErrors(errors, margins, max(part.seconds for part in parts))
