"""Diagnose a fit: faults of its data, and effects that its model lacks.

`clean` runs before the search, `diagnose` after it.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic
from baqueano.identify.diagnostics import channel_map, physical_units, residual_checks, samples, timestamps
from baqueano.numerics.parallel import parallel_map
from baqueano.runs.run import Run

if TYPE_CHECKING:
    from baqueano.identify.identifiability.identifiable import FinishedFit
    from baqueano.vehicle_file import VehicleFile

UNIT_CODES = {"gyro.unit", "gyro.too-fast", "command.unit", "time.unit"}


def clean(
    runs: list[Run], vehicle_file: "VehicleFile", sensors: dict[str, Tree]
) -> tuple[list[Run], tuple[Diagnostic, ...]]:
    """Return the runs without impossible measurements, split at jumps of time, and messages on the faults."""

    def clean_run(run: Run) -> tuple[list[Run], list[Diagnostic]]:
        segments, messages = timestamps.check_timestamps(run, vehicle_file.rate_hz)
        messages += physical_units.implausible_values(run, vehicle_file, sensors)
        clean_segments = []
        for segment in segments:
            channels, sample_messages = _samples(segment, sensors)
            messages += sample_messages
            clean_segments.append(channels)
        if len(runs) > 1:
            messages = [replace(m, figures={**m.figures, "of_run": run.name}) for m in messages]
        return clean_segments, messages

    results = parallel_map(clean_run, runs, rows=sum(len(run.t_ns) for run in runs))
    messages = tuple(message for _, messages in results for message in messages)
    return [run for segments, _ in results for run in segments], messages


def _samples(run: Run, sensors: dict[str, Tree]) -> tuple[Run, list[Diagnostic]]:
    channels, messages = dict(run.sensors), []
    for name, block in sensors.items():
        if name in channels and channels[name].z.shape[1] == block.size:
            channels[name], sensor_messages = samples.check_samples(name, block, channels[name])
            messages += sensor_messages
    return replace(run, sensors=channels) if messages else run, messages


def diagnose(end: "FinishedFit", std: np.ndarray, file_sigma: np.ndarray) -> residual_checks.Diagnosis:
    """Return messages on a finished search and its data, and their consequences for the shared entries of θ.

    `std` (p,) are the standard errors of θ, `file_sigma` (m,) the noise of the channels in the file.
    """
    problem, theta, mask = end.task.problem, end.search.solution.theta, end.identifiability.mask
    s, is_finite, is_start = problem.layout.shared_count, np.isfinite(theta).all(), np.ones(len(theta), bool)
    identifiable = np.concatenate([mask, is_start[len(mask) :]])  # starts of segments
    messages = channel_map.check_channels(problem, theta) if is_finite else []
    earlier_messages = list(end.findings)
    if not UNIT_CODES & {message.code for message in earlier_messages}:
        errors, is_cleared = physical_units.check_gyro_against_model(end)
        messages += errors
        cleared_codes = {physical_units.CURVE_CODE} if is_cleared else set()
        earlier_messages = [message for message in earlier_messages if message.code not in cleared_codes]
    if not (end.search.solution.converged and is_finite and identifiable[:s].any()):
        # without a fit, compare the axes with the predictions at the start of the search
        codes = {message.code for message in messages}
        at_start = channel_map.check_channels(problem, end.task.start)
        messages += [message for message in at_start if message.code not in codes]
        messages = earlier_messages + channel_map.with_mount_findings(end, messages)
        return residual_checks.Diagnosis(messages, np.zeros((s, s)), np.zeros(s))
    estimate, sigma = np.where(identifiable[:s], theta[:s], np.nan), end.search.sigma
    messages += channel_map.check_gain_changes(
        end.blocks, problem.shape.shared, estimate, std[:s], file_sigma, sigma, problem.labels
    )
    diagnosis = residual_checks.check_residuals(
        end.blocks, problem, theta, identifiable, std, (end.task.low, end.task.high)
    )
    messages = channel_map.with_mount_findings(end, messages + diagnosis.messages)
    return diagnosis._replace(messages=earlier_messages + messages)
