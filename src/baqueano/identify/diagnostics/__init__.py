"""Diagnose a finished search: channels, gains and units of its data, and effects that its model lacks."""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.identify.diagnostics import file_consistency, residual_checks
from baqueano.identify.diagnostics.wheels import wheel_findings
from baqueano.runs.diagnostics.physical_units import CURVE_CODE

if TYPE_CHECKING:
    from baqueano.identify.identifiability import FinishedFit

UNIT_CODES = {"gyro.unit", "gyro.too-fast", "command.unit", "time.unit"}


def diagnose(end: "FinishedFit", std: np.ndarray, file_sigma: np.ndarray) -> residual_checks.Diagnosis:
    """Return messages on a finished search and its data, and their consequences for the shared entries of θ.

    `std` (p,) are the standard errors of θ, `file_sigma` (m,) the noise of the channels in the file,
    0 if it was not measured.
    """
    problem, theta, mask = end.task.problem, end.search.solution.theta, end.identifiability.mask
    s, is_finite, is_start = problem.layout.shared_count, np.isfinite(theta).all(), np.ones(len(theta), bool)
    identifiable = np.concatenate([mask, is_start[len(mask) :]])  # starts of segments
    messages = file_consistency.check_channels(problem, theta) if is_finite else []
    earlier_messages = list(end.findings)
    if not UNIT_CODES & {message.code for message in earlier_messages}:
        errors, is_cleared = file_consistency.check_gyro_against_model(end)
        messages += errors
        cleared_codes = {CURVE_CODE} if is_cleared else set()
        earlier_messages = [message for message in earlier_messages if message.code not in cleared_codes]
    earlier_messages += wheel_findings(end)
    if not (end.search.solution.converged and is_finite and identifiable[:s].any()):
        # without a fit, compare the axes with the predictions at the start of the search
        codes = {message.code for message in messages}
        at_start = file_consistency.check_channels(problem, end.task.start)
        messages += [message for message in at_start if message.code not in codes]
        messages = earlier_messages + file_consistency.with_mount_findings(end, messages)
        return residual_checks.Diagnosis.of(messages, s)
    estimate, sigma = np.where(identifiable[:s], theta[:s], np.nan), end.search.sigma
    messages += file_consistency.gain_findings(end.blocks, problem.shape.shared_paths, estimate, std[:s])
    messages += file_consistency.noise_findings(file_sigma, sigma, problem.labels)
    bounds = end.task.low, end.task.high
    diagnosis = residual_checks.check_residuals(end.blocks, problem, theta, identifiable, std, bounds)
    messages = file_consistency.with_mount_findings(end, messages + diagnosis.messages)
    return diagnosis._replace(messages=earlier_messages + messages)
