"""A fit on runs that it has not seen: simulated from the commands alone, parameters as they are.

    e = z − h(θ̂),   error = √ mean e²,   explained = 1 − Σ e² / Σ (z − z̄)²                                 (1)

What belongs to a run and not to the vehicle, the IMU's biases and the velocity at the start, is found on the run
itself: nobody knows it before. Everything else is the fit's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.answer.channel_units import channel_unit
from baqueano.identify.answer.result import ChannelFit, Fit
from baqueano.identify.fit import identify
from baqueano.identify.rows.tape import KINDS
from baqueano.runs.run import Run

EXPLAINED = 0.5  # of the part that the fit explains of its own runs: below it the model does not carry over


class Figure(NamedTuple):
    """One channel of one unseen run."""

    run: str
    channel: str
    error: float  # root mean square
    explained: float
    on_own_runs: float  # explained of the runs that the fit was made from
    unit: str = ""  # of error


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """All channels of all unseen runs."""

    figures: tuple[Figure, ...]
    channels: tuple[ChannelFit, ...]
    reasons: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """WARN where a channel carries over badly."""
        return "WARN" if self.reasons else "USABLE"

    def rows(self) -> list[dict[str, Any]]:
        """One flat row per run and channel."""
        return [figure._asdict() for figure in self.figures]

    def table(self) -> str:
        """For people."""
        lines = [f"{'held out':20} {'channel':14} {'error':>10}        {'explained':>10} {'own runs':>10}"]
        for f in self.figures:
            parts = f"{100 * f.explained:>9.1f}% {100 * f.on_own_runs:>9.1f}%"
            lines.append(f"{f.run:20} {f.channel:14} {f.error:>10.3g} {f.unit:6} {parts}")
        return "\n".join([*lines, f"{self.verdict}: {'; '.join(self.reasons) or 'the model carries over'}"])


def judge(fit: Fit, runs: Run | Sequence[Run]) -> Judged:
    """`fit` on `runs`. UsageError where it was made from one of them, or was refused."""
    runs = [runs] if isinstance(runs, Run) else list(runs)
    if fit.verdict == "REFUSED":
        raise UsageError("the fit is refused, so there is nothing to judge: mend that first.")
    again = [run.name for run in runs if run.name in fit.runs]
    if again:
        raise UsageError(f"{again[0]} was fitted to, so it cannot judge. Give another run to --held-out.")
    sigma = {name: noise for name, noise in fit.sigma.items() if name not in KINDS}  # no tape lies in them
    own = {(c.sensor, c.entry): c.explained for c in fit.channels}
    channels: list[ChannelFit] = []
    file = fit.vehicle_file
    for run in runs:
        channels += identify(
            run, file, (), use=tuple(sigma), sigma=sigma, doubts=False, backend=fit.backend
        ).channels
    figures, reasons = [], []
    for c in channels:
        left = c.measured - c.predicted
        if not np.isfinite(left).any() or not np.isfinite(c.explained):
            continue
        part = 1.0 - float(np.nanmean(left**2) / max(np.nanvar(c.measured), 1e-300))
        said = own.get((c.sensor, c.entry), np.nan)
        label, error = f"{c.sensor}[{c.entry}]", float(np.sqrt(np.nanmean(left**2)))
        figures.append(Figure(c.run, label, error, part, said, channel_unit(file, c.sensor, c.entry)))
        if said > EXPLAINED and part < EXPLAINED * said:
            reasons.append(
                f"of {label} the model explains {100 * max(part, 0.0):.0f} % of {c.run}, and {100 * said:.0f} % of "
                "its own runs"
            )
    return Judged(tuple(figures), tuple(channels), tuple(reasons))
