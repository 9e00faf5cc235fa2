"""Run `baqueano experiment --signal designed --rounds N`: rounds of design, drive and fit.

Each round is designed for the vehicle that is identified from all previous runs, and is a separate run. Afterwards all
runs are fitted together. Every run begins in the middle of the room.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.cli import options
from baqueano.cli.terminal import print_message, show_activity, show_time_progress
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict, note
from baqueano.errors import AnswerNo
from baqueano.messages import texts, verdict_line
from baqueano.messages.language import number, translate as _

if TYPE_CHECKING:
    from baqueano.cli.driving.targets import Target
    from baqueano.identify.result.fit_result import Fit
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile


class Round(NamedTuple):
    """A round: the path of its run, and the fit to all runs so far."""

    run: Path
    fit: "Fit"

    def relative_std(self, name: str) -> float | None:
        """Return the standard error of a parameter relative to its value; None if the parameter was not estimated."""
        if name not in self.fit.names:
            return None
        k = self.fit.names.index(name)
        error = self.fit.std[k] / abs(self.fit.estimate[k]) if self.fit.estimate[k] else np.nan
        return float(error) if np.isfinite(error) else None


@dataclass(frozen=True, slots=True, eq=False)
class Rounds:
    """The errors of the parameters in each round."""

    rounds: tuple[Round, ...]

    @property
    def verdict(self) -> Verdict:
        """Return the verdict of the last fit."""
        return self.rounds[-1].fit.verdict

    def rows(self) -> list[TableRow]:
        """Return a flat row per round and parameter."""
        rows = []
        for k, iteration in enumerate(self.rounds):
            for name, x in zip(iteration.fit.names, iteration.fit.estimate, strict=True):
                estimate = float(x) if np.isfinite(x) else None
                row = {"round": k + 1, "run": iteration.run.stem, "name": name, "estimate": estimate}
                rows.append(row | {"relative_std": iteration.relative_std(name)})
        return rows

    def table(self) -> str:
        """Return a line for each parameter, with a column for each round."""
        names = list(dict.fromkeys(name for iteration in self.rounds for name in iteration.fit.names))
        width = max(map(len, (*names, _("standard error of"))))
        head = "".join(f"{_('round {k}', k=k + 1):>12}" for k in range(len(self.rounds)))
        lines = [f"{_('standard error of'):{width}}{head}"]
        for name in names:
            stds = [iteration.relative_std(name) for iteration in self.rounds]
            cells = ["—" if std is None else f"{number(100.0 * std):.3g} %" for std in stds]
            lines.append(f"{name:{width}}" + "".join(f"{x:>12}" for x in cells))
        return "\n".join([*lines, "", verdict_line(self.verdict, self.rounds[-1].fit.reasons)])


def drive_in_rounds(
    vehicle_file: "VehicleFile", target: "Target", runs: "list[Run]", rounds: int,
    signal: Callable[[Any, int], np.ndarray], seed: int, backend: str, round_path: Callable[[str], Path],
) -> Rounds:  # fmt: skip
    """Drive `rounds` times with `signal(vehicle_file, seed)`. After each drive fit all `runs` so far. The next
    signal is planned with `planning_file` of this fit.

    Return the rounds. Raise AnswerNo if a fit is refused.
    """
    from baqueano.design.vehicle_cloud import planning_file
    from baqueano.drive.mission import Mission
    from baqueano.identify import FitOptions, identify

    results: list[Round] = []
    for k in range(rounds):
        u = signal(vehicle_file, seed + k)
        path = round_path(f"{k + 1}")
        if k:
            target.return_to_middle()
        with show_time_progress(note("cli.round", number=k + 1), len(u) / vehicle_file.rate_hz) as progress:
            run = target.drive(Mission("experiment", u=u), vehicle_file, path, progress, seed=seed + k)
        print_message(note("cli.run", path=path))
        options.raise_stop(run, path)
        runs.append(run)
        with show_activity(note("cli.fitting", runs=len(runs))):
            fit = identify(runs, vehicle_file, options=FitOptions(backend=backend))
        reasons = "; ".join(texts(fit.reasons))
        print_message(note("cli.round-fitted", round=k + 1, verdict=fit.verdict, reasons=reasons))
        if fit.verdict == Verdict.REFUSED:
            raise AnswerNo.of("cli.round-refused", round=k + 1, reasons=reasons, path=path)
        vehicle_file = planning_file(fit, vehicle_file)
        results.append(Round(path, fit))
    return Rounds(tuple(results))
