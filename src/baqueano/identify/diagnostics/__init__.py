"""Doubts about a fit: what is wrong with its data, and what is not in its model.

`mended` runs before the search, `structure` and `against_file` after it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic
from baqueano.identify.diagnostics import (
    against_file,
    axes,
    samples,
    stamps,
    structure,
    turning,
)
from baqueano.identify.parallel import each
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.identify.identifiability.identifiable import FinishedFit
    from baqueano.vehicle_file import VehicleFile

__all__ = ["afterwards", "mended", "widened"]


def mended(
    runs: list[Run], file: "VehicleFile", sensors: dict[str, Tree]
) -> tuple[list[Run], tuple[Diagnostic, ...]]:
    """The runs without what is no measurement, cut where time jumps, and what was found."""

    def of(run: Run) -> tuple[list[Run], list[Diagnostic]]:
        pieces, said = stamps.checked(run, file.rate_hz)
        said += turning.implausible(run, file, sensors)
        out = []
        for piece in pieces:
            channels, said_of = _samples(piece, sensors)
            said += said_of
            out.append(channels)
        if len(runs) > 1:
            said = [replace(one, figures={**one.figures, "of_run": run.name}) for one in said]
        return out, said

    found = each(of, runs, rows=sum(len(run.t_ns) for run in runs))
    return [run for mended_runs, _ in found for run in mended_runs], tuple(
        one for _, said in found for one in said
    )


def _samples(run: Run, sensors: dict[str, Tree]) -> tuple[Run, list[Diagnostic]]:
    channels, found = dict(run.sensors), []
    for name, block in sensors.items():
        if name in channels and channels[name].z.shape[1] == block.size:
            channels[name], said = samples.checked(name, block, channels[name])
            found += said
    return replace(run, sensors=channels) if found else run, found


def afterwards(
    end: "FinishedFit", sd: np.ndarray, told: np.ndarray
) -> tuple[list[Diagnostic], dict[str, float]]:
    """Return all that a finished search leaves to doubt, its data too, with the errors `sd` (p,)
    of θ and the noise `told` (m,) by the file; and by how much each parameter, by path, may be off for it."""
    problem, theta, kept = end.task.problem, end.found.solution.theta, end.sight.kept
    s = problem.layout.shared
    kept = np.concatenate([kept, np.ones(problem.layout.size - len(kept), bool)])  # starts of pieces

    found, before = axes.checked(problem, theta) if np.isfinite(theta).all() else [], list(end.doubts)
    if not {one.code for one in before} & {"gyro.unit", "gyro.too-fast", "command.unit", "time.unit"}:
        accused, cleared = turning.against_model(end)
        found += accused
        before = [one for one in before if not (cleared and one.code == turning.CURVE)]
    if not (end.found.solution.converged and np.isfinite(theta).all() and kept[:s].any()):
        # no fit to hold the axes against: what the search began with says how they should go
        known = {one.code for one in found}
        found += [one for one in axes.checked(problem, end.task.first) if one.code not in known]
        return before + axes.with_mount(end, found), {}
    labels = [f"{name}[{i}]" for name, m in zip(problem.names, problem.sizes, strict=True) for i in range(m)]
    estimate, sigma = np.where(kept[:s], theta[:s], np.nan), end.found.sigma
    found += against_file.checked(end.blocks, problem.shape.shared, estimate, sd[:s], told, sigma, labels)
    left_over, off = structure.checked(end.blocks, problem, theta, kept, sd)
    return before + axes.with_mount(end, found + left_over), off


def widened(cov: np.ndarray, names: Sequence[str], off: Mapping[str, float]) -> np.ndarray:
    """Return `cov` (p, p) of the parameters `names` with what each, by path, may be `off` by."""
    return cov + np.diag([off.get(name, 0.0) ** 2 for name in names])
