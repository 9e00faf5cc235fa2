"""Diagnose a fit: faults of its data, and effects that its model lacks.

`clean` runs before the search, `diagnose` after it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic
from baqueano.identify.diagnostics import (
    channel_map,
    gain_changes,
    physical_units,
    residual_checks,
    samples,
    timestamps,
)
from baqueano.identify.parallel import parallel_map
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.identify.identifiability.identifiable import FinishedFit
    from baqueano.vehicle_file import VehicleFile


def clean(
    runs: list[Run], file: "VehicleFile", sensors: dict[str, Tree]
) -> tuple[list[Run], tuple[Diagnostic, ...]]:
    """Return the runs without impossible measurements, cut at jumps of time, and messages on the repairs."""

    def of(run: Run) -> tuple[list[Run], list[Diagnostic]]:
        segments, messages = timestamps.check_timestamps(run, file.rate_hz)
        messages += physical_units.implausible(run, file, sensors)
        out = []
        for segment in segments:
            channels, words_of = _samples(segment, sensors)
            messages += words_of
            out.append(channels)
        if len(runs) > 1:
            messages = [
                replace(message, figures={**message.figures, "of_run": run.name}) for message in messages
            ]
        return out, messages

    results = parallel_map(of, runs, rows=sum(len(run.t_ns) for run in runs))
    return [run for segments, _ in results for run in segments], tuple(
        message for _, messages in results for message in messages
    )


def _samples(run: Run, sensors: dict[str, Tree]) -> tuple[Run, list[Diagnostic]]:
    channels, messages = dict(run.sensors), []
    for name, block in sensors.items():
        if name in channels and channels[name].z.shape[1] == block.size:
            channels[name], of_sensor = samples.check_samples(name, block, channels[name])
            messages += of_sensor
    return replace(run, sensors=channels) if messages else run, messages


def diagnose(
    end: "FinishedFit", sd: np.ndarray, file_sigma: np.ndarray
) -> tuple[list[Diagnostic], dict[str, float]]:
    """Return messages on a finished search and its data, and the error of each parameter that they cause, by path.
    `sd` (p,) are the standard errors of θ, `file_sigma` (m,) the noise of the channels in the file."""
    problem, theta, identifiable = (
        end.task.problem,
        end.search.solution.theta,
        end.identifiability.mask,
    )
    s = problem.layout.shared
    identifiable = np.concatenate(
        [identifiable, np.ones(problem.layout.size - len(identifiable), bool)]
    )  # starts of segments

    messages, before = (
        channel_map.check_channels(problem, theta) if np.isfinite(theta).all() else [],
        list(end.findings),
    )
    if not {message.code for message in before} & {"gyro.unit", "gyro.too-fast", "command.unit", "time.unit"}:
        errors, is_cleared = physical_units.against_model(end)
        messages += errors
        before = [message for message in before if not (is_cleared and message.code == physical_units.CURVE)]
    if not (end.search.solution.converged and np.isfinite(theta).all() and identifiable[:s].any()):
        # without a fit, compare the axes with the predictions at the start of the search
        codes = {message.code for message in messages}
        messages += [
            message
            for message in channel_map.check_channels(problem, end.task.first)
            if message.code not in codes
        ]
        return before + channel_map.with_mount(end, messages), {}
    labels = [f"{name}[{i}]" for name, m in zip(problem.names, problem.sizes, strict=True) for i in range(m)]
    estimate, sigma = np.where(identifiable[:s], theta[:s], np.nan), end.search.sigma
    messages += gain_changes.check_gain_changes(
        end.blocks, problem.shape.shared, estimate, sd[:s], file_sigma, sigma, labels
    )
    findings_of_residuals, off = residual_checks.check_residuals(end.blocks, problem, theta, identifiable, sd)
    return before + channel_map.with_mount(end, messages + findings_of_residuals), off


def inflate_covariance(cov: np.ndarray, names: Sequence[str], off: Mapping[str, float]) -> np.ndarray:
    """Return `cov` (p, p) of the parameters `names`, enlarged by the errors `off` (path → error)."""
    return cov + np.diag([off.get(name, 0.0) ** 2 for name in names])
