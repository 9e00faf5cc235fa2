"""Assemble the `Fit` of a finished search: named parameters, messages and a verdict from θ of all runs."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.identify.covariance.clusters import jackknife, with_larger_errors
from baqueano.identify.covariance.information import parameter_cov
from baqueano.identify.data.added_channels import MOUNT_PREFIX, TRUTH
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.diagnostics import diagnose
from baqueano.identify.diagnostics.residual_checks import Diagnosis
from baqueano.identify.identifiability import (
    FinishedFit,
    has_one_mean,
    missing_command,
    unobservable_reason,
    weak_reason,
)
from baqueano.identify.parameters.free import DELAY_PATH, FreeParameter, substitute, value
from baqueano.identify.parameters.theta import START_NAMES
from baqueano.identify.residuals.informative_rows import sensor_sigma
from baqueano.identify.residuals.simulation import Residuals
from baqueano.identify.result.fit_result import ChannelFit, Fit
from baqueano.identify.result.to_vehicle_file import fit_envelope, kept_priors
from baqueano.identify.result.verdict import Evidence, fit_verdict, group_channels, remarks
from baqueano.messages.language import translate as _
from baqueano.numerics.autocorrelation import WHITE_LIMIT
from baqueano.numerics.normal_equations import pseudo_inverse
from baqueano.numerics.parallel import parallel_map
from baqueano.numerics.statistics import explained_variance
from baqueano.sensors.sampling import is_imu
from baqueano.vehicle_file.plausibility import value_problems
from baqueano.vehicle_file.provenance import is_measured
from baqueano.vehicles.freedoms import damping_derivatives, sign_speed_paths

MAX_BOUND_EXCESS_SIGMA = 3.0  # a parameter that would move less can be at its bound by chance
EXPERIMENT = "baqueano experiment --signal designed --rounds 3 --update"


class VerdictBasis(NamedTuple):
    """Data for the verdict on a finished search: errors, diagnostics, bounds."""

    cov: np.ndarray  # (p, p) of θ
    diagnosis: Diagnosis
    evidence: Evidence
    bound_excess: np.ndarray  # (p,) −1 or 1 if a bound limits a parameter significantly
    always_unobservable: tuple[Diagnostic, ...]  # parameters that no motion of the vehicle can identify


def verdict_basis(end: FinishedFit) -> VerdictBasis:
    """Return all data on which the verdict on a finished search depends."""
    cov = _covariance(end)
    std = np.sqrt(np.diagonal(cov))
    unobservable_terms, always_unobservable = _unobservable(end)
    diagnosis = _diagnosis(end, std)
    evidence = _evidence(end, tuple(diagnosis.messages), unobservable_terms)
    s = len(diagnosis.unmodelled_cov)
    total_std = np.sqrt(np.diagonal(cov)[:s] + np.diagonal(diagnosis.unmodelled_cov))
    evidence = evidence._replace(speed_warnings=tuple(_undetermined_damping(end, total_std)))
    is_held_back = _requested_order(end, _bound_excess(end, std), 0.0) > MAX_BOUND_EXCESS_SIGMA
    return VerdictBasis(
        cov, diagnosis, evidence, np.where(is_held_back, evidence.bound, 0), always_unobservable
    )


def _undetermined_damping(end: FinishedFit, std: np.ndarray) -> list[Diagnostic]:
    """Return a warning of frictions without which a fit to an IMU only cannot predict a speed; dry frictions do not
    count. `std` (s,) are the standard errors. A friction of forward motion is unknown if it is not identifiable and was
    never measured. It is also unknown at its bound 0, if its error is as large as its start. A friction of sideways
    motion is unknown if it is poorly identified and at 0. Other sensors show the speed itself."""
    model, identifiability, names = end.blocks.model, end.identifiability, []
    if not all(is_imu(getattr(end.blocks.sensors, name)) for name in end.task.problem.names):
        return []
    fields = {parameter.path.partition("[")[0] for parameter in end.parameters.free}
    is_at_lower = end.search.solution.bound[: len(identifiability.mask)] < 0
    if np.all(identifiability.mask & ~is_at_lower):
        return []
    slopes = dict(damping_derivatives(model, fields - sign_speed_paths(model).keys()))
    for i, parameter in enumerate(end.parameters.free):
        forward, sideways = slopes.get(parameter.path, np.zeros(3))[:2] > 0.0
        is_guess = not is_measured(end.vehicle_file.provenance, parameter.path.partition("[")[0])
        is_wide = std[i] >= abs(end.task.start[i]) if forward else identifiability.poorly_identified[i]
        is_unknown = (
            end.search.solution.bound[i] < 0 and is_wide if identifiability.mask[i] else forward and is_guess
        )
        names += [parameter.path] if is_unknown and (forward or sideways) else []
    return [note("fit.speed-unknown", Severity.WARNING, EXPERIMENT, names=", ".join(names))] if names else []


def is_only_autocorrelated(basis: VerdictBasis) -> bool:
    """Return True if autocorrelation and size of the residuals are the only findings about a fit."""
    with_prior = basis.evidence._replace(bound=basis.bound_excess)
    return (
        fit_verdict(with_prior)[0] == Verdict.WARN
        and fit_verdict(_without_autocorrelation(with_prior))[0] == Verdict.USABLE
    )


def _without_autocorrelation(evidence: Evidence) -> Evidence:
    """Return the evidence without autocorrelation and size of the residuals, which process noise explains."""
    messages = tuple(message for message in evidence.messages if message.code != "residual.autocorrelated")
    return evidence._replace(
        messages=messages, prior_sigma=None, autocorrelation=np.zeros(len(evidence.autocorrelation))
    )


def assemble_fit(end: FinishedFit, basis: VerdictBasis | None = None) -> Fit:
    """Return the Fit of a finished search; a given `basis` is not computed again."""
    basis = verdict_basis(end) if basis is None else basis
    problem, solution = end.task.problem, end.search.solution
    evidence = _without_autocorrelation(basis.evidence) if end.is_explained_by_floor else basis.evidence
    verdict, reasons = fit_verdict(evidence._replace(bound=basis.bound_excess))
    s = len(problem.shape.shared_paths)
    requested_parameters, theta_indices = end.parameters.requested_parameters, end.parameters.theta_indices
    shared_cov, unmodelled_cov = np.full((2, len(requested_parameters), len(requested_parameters)), np.nan)
    shared_entries, run_std = np.ix_(theta_indices, theta_indices), np.sqrt(np.diagonal(basis.cov))
    run_rows = slice(s, problem.layout.first_start)
    run_std[run_rows] = np.hypot(run_std[run_rows], basis.diagnosis.run_errors)
    unmodelled_cov[shared_entries] = basis.diagnosis.unmodelled_cov
    shared_cov[shared_entries] = basis.cov[:s, :s] + basis.diagnosis.unmodelled_cov
    run_entry_names, run_values, run_entry_std = _run_entries(problem, solution.theta, run_std)
    commands = end.vehicle_file.command.names
    unmodelled_shifts = np.zeros((len(basis.diagnosis.shifts), len(requested_parameters)))
    unmodelled_shifts[:, theta_indices] = basis.diagnosis.shifts
    shifts = np.zeros((len(end.fixed.paths), len(requested_parameters)))
    shifts[:, theta_indices] = end.fixed.shifts[:, :s]
    start = np.array([value(end.blocks, parameter.path) for parameter in requested_parameters])
    start[theta_indices] = end.task.start[: len(theta_indices)]
    fit = Fit(
        names=evidence.names,
        units=tuple(parameter.unit for parameter in requested_parameters),
        start=start,
        estimate=evidence.estimate,
        std=np.sqrt(np.diagonal(shared_cov)),
        bound=evidence.bound,
        poorly_identified=evidence.poorly_identified,
        cov=shared_cov,
        unmodelled_cov=unmodelled_cov,
        unmodelled_shifts=unmodelled_shifts,
        unmodelled_speeds=basis.diagnosis.speed_changes,
        fixed=end.fixed._replace(shifts=shifts),
        run_entry_names=run_entry_names,
        run_entries=run_values,
        run_entry_std=run_entry_std,
        unobservable=evidence.unobservable,
        always_unobservable=basis.always_unobservable,
        verdict=verdict,
        reasons=reasons,
        notes=(*_notes(end), *remarks(evidence._replace(bound=evidence.bound - basis.bound_excess))),
        channels=evidence.channels,
        sigma={name: end.search.sigma[span] for name, span in problem.spans.items()},
        autocorrelated=end.info.autocorrelated,
        converged=solution.converged,
        cost=solution.evaluation.cost,
        evaluations=end.search.evaluations,
        runs=_runs(problem),
        backend=problem.scan.backend,
        file=end.vehicle_file,
        blocks=_fitted_blocks(end),
        envelope=fit_envelope(problem.records, evidence.channels, end.blocks.sensors, commands),
    )
    messages = [prior.message for prior in kept_priors(fit) if prior.contradicted or not prior.at_rest]
    return replace(fit, notes=(*fit.notes, *messages))


def _diagnosis(end: FinishedFit, std: np.ndarray) -> Diagnosis:
    """Return all diagnostics of the fit, and their consequences for the shared entries of θ."""
    report = end.task.progress or (lambda text: None)
    is_skipped = not end.score_test or end.search.stopped
    if is_skipped or report(_("testing for effects that the model lacks")) is True:
        s = end.task.problem.layout.shared_count
        return Diagnosis.of(list(end.findings), s)
    sensors, origins = end.blocks.sensors, end.vehicle_file.provenance
    measured = [is_measured(origins, f"sensors.{name}.measurement_noise_cov") for name in sensors._fields]
    is_known = np.repeat(measured, [sensor.size for sensor in sensors])
    return diagnose(end, std, np.where(is_known, sensor_sigma(sensors), 0.0))


def _bound_excess(end: FinishedFit, std: np.ndarray) -> np.ndarray:
    """Return the distance (s,), in standard errors, by which each shared entry of θ would move without its bounds.
    It is inf without a requested test or after a stop, and 0 if the search did not converge."""
    s, solution = end.task.problem.layout.shared_count, end.search.solution
    if not end.score_test or end.search.stopped:
        return np.full(s, np.inf)
    identifiable, moves_in_std = np.flatnonzero(end.identifiability.mask), np.zeros(s)
    g = solution.evaluation.gradient[identifiable]
    if solution.converged and len(identifiable) and np.isfinite(g).all():
        inverse = pseudo_inverse(end.info.bread[np.ix_(identifiable, identifiable)])
        moves = np.abs(inverse @ g) / std[identifiable]
        moves_in_std[identifiable[identifiable < s]] = moves[identifiable < s]
    return moves_in_std


def _evidence(
    end: FinishedFit, findings: tuple[Diagnostic, ...], unobservable_terms: tuple[Diagnostic, ...]
) -> Evidence:
    """Return the evidence for the verdict."""
    solution, s = end.search.solution, len(end.task.problem.shape.shared_paths)
    identifiable = end.identifiability.mask[:s]
    channels = _channels(end.task.problem, solution.theta, end.search.sigma, end.info.autocorrelation)
    return Evidence(
        tuple(parameter.path for parameter in end.parameters.requested_parameters),
        _requested_order(end, np.where(identifiable, solution.theta[:s], np.nan), np.nan),
        _requested_order(end, np.where(identifiable, solution.bound[:s], 0), 0).astype(int),
        _requested_order(end, end.identifiability.poorly_identified[:s], fixed_value=False).astype(bool),
        len(end.parameters.fixed_indices),
        unobservable_terms,
        channels,
        group_channels(channels, has_one_mean(end.task.problem)),
        solution.converged,
        end.info.autocorrelation,
        None if end.task.fixed_sigma is not None else sensor_sigma(end.blocks.sensors),
        (*findings, *value_problems(end.vehicle_file, *_fitted_blocks(end))),
        tuple(
            weak_reason(parameter, end.confused_parameters(end.identifiability.correlated, i))
            for i, parameter in enumerate(end.parameters.free)
            if end.identifiability.poorly_identified[i]
        ),
        _most_moving(end),
    )


def _covariance(end: FinishedFit) -> np.ndarray:
    """Return the covariance of θ (p, p), NaN for fixed entries."""
    mask, problem = end.identifiability.mask, end.task.problem
    identifiable, full_cov = np.flatnonzero(mask), np.full((len(mask), len(mask)), np.nan)
    if not len(identifiable):
        return full_cov
    index, cov = np.ix_(identifiable, identifiable), parameter_cov(end.info, identifiable)
    k = int(np.sum(identifiable < problem.layout.shared_count))
    for by_segment in () if end.is_filtered else (False, True):  # the innovations of a filter are white
        scatter = jackknife(end.info, problem.layout, identifiable, is_limited=True, by_segment=by_segment)
        cov = with_larger_errors(problem, cov, scatter, k, by_segment)
    full_cov[index] = cov + end.fixed.estimate_cov[index]
    return full_cov


def _run_entries(
    problem: Residuals, theta: np.ndarray, std: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Return names (q,), values and standard errors (runs, q) of the entries that each run has separately. The starts
    are included if the runs are not split."""
    layout, shape = problem.layout, problem.shape
    runs, s = layout.run_count, layout.shared_count
    by_run = theta[s : layout.first_start].reshape(runs, -1)
    by_run_std = std[s : layout.first_start].reshape(runs, -1)
    if layout.has_split_runs:
        return shape.by_run, by_run, by_run_std
    names = (*shape.by_run, *(f"start.{START_NAMES[i]}" for i in shape.start))
    starts, starts_std = (x[layout.first_start :].reshape(runs, -1) for x in (theta, std))
    return names, np.hstack([by_run, starts]), np.hstack([by_run_std, starts_std])


def _runs(problem: Residuals) -> tuple[str, ...]:
    """Return the names of the runs, each once."""
    return tuple({record.run: record.name for record in problem.records}.values())


def _requested_order(end: FinishedFit, values: np.ndarray, fixed_value: float) -> np.ndarray:
    """Return the shared `values` in the order of `requested_parameters`, `fixed_value` for fixed ones."""
    ordered_values = np.full(len(end.parameters.requested_parameters), fixed_value, dtype=float)
    ordered_values[end.parameters.theta_indices] = values
    return ordered_values


def _channels(
    problem: Residuals, theta: np.ndarray, sigma: np.ndarray, autocorrelation: np.ndarray
) -> tuple[ChannelFit, ...]:
    """Return the channels of each run, in the order of the sensors."""
    labels = [(name, i) for name, m in zip(problem.names, problem.sizes, strict=True) for i in range(m)]
    segments = list(zip(problem.records, problem.predictions(theta), problem.z, problem.masks, strict=True))

    def run_channels(run: int, run_name: str) -> list[ChannelFit]:
        of_run = [(r.lead, (r.t_s, h, z, mask > 0.0)) for r, h, z, mask in segments if r.run == run]
        rows = [[column[lead:] for column in columns] for lead, columns in of_run]
        t_s, h, z, mask = (np.concatenate(column) for column in zip(*rows, strict=True))
        shares = [explained_variance(z[w, c], h[w, c], sigma[c]) for c, w in enumerate(mask.T)]
        readings = np.where(mask, z, np.nan)
        std, rho = sigma.tolist(), autocorrelation.tolist()
        return [
            ChannelFit(run_name, *label, t_s, readings[:, c], h[:, c], std[c], shares[c], rho[c])
            for c, label in enumerate(labels)
        ]

    names = list(_runs(problem))
    channels = parallel_map(run_channels, range(len(names)), names, rows=sum(map(len, problem.z)))
    return tuple(channel for of_run in channels for channel in of_run)


def _unobservable(end: FinishedFit) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
    """Return findings on parameters that a better run would show, and findings on parameters that no run can show."""
    unobservable_terms, always_unobservable = [], []
    columns: dict[int, list[FreeParameter]] = {}
    for parameter in (end.parameters.requested_parameters[k] for k in end.parameters.fixed_indices):
        assert parameter.column is not None
        columns.setdefault(parameter.column, []).append(parameter)
    n, drivetrain = len(end.vehicle_file.command.names), end.blocks.model.drivetrain
    command = end.vehicle_file.command
    for j, unused_parameters in columns.items():
        is_impossible = bool(command.limit[j] == 0.0) or not np.any(drivetrain.mix(np.eye(n)[j]))
        message = missing_command(unused_parameters, command.names[j], is_impossible)
        (always_unobservable if is_impossible else unobservable_terms).append(message)
    for i in np.flatnonzero(~end.identifiability.mask[: len(end.parameters.free)]).tolist():
        pairs = end.identifiability.collinear, end.identifiability.correlated
        collinear, partners = (end.confused_parameters(pair, i) for pair in pairs)
        parameter, start = end.parameters.free[i], float(end.task.start[i])
        is_needless = parameter.axis is not None and parameter.axis not in drivetrain.driven_axes
        is_needless &= start == parameter.definition.neutral
        reason = unobservable_reason(parameter, collinear, start, partners)
        (always_unobservable if is_needless else unobservable_terms).append(reason)
    return tuple(unobservable_terms), tuple(always_unobservable)


def _most_moving(end: FinishedFit) -> str:
    """Return the path that a search without convergence would still move most in standard errors, else ""."""
    solution, s = end.search.solution, len(end.task.problem.shape.shared_paths)
    free_entries = np.flatnonzero(end.identifiability.mask[:s] & (solution.bound[:s] == 0))
    A, g = end.info.bread[np.ix_(free_entries, free_entries)], solution.evaluation.gradient[free_entries]
    if solution.converged or not len(free_entries) or not (np.isfinite(A).all() and np.isfinite(g).all()):
        return ""
    inverse = np.linalg.pinv(A, hermitian=True)
    moves = np.abs(inverse @ g) / np.sqrt(np.maximum(np.diagonal(inverse), 1e-300))
    return end.task.problem.shape.shared_paths[free_entries[np.argmax(moves)]]


def _notes(end: FinishedFit) -> tuple[Diagnostic, ...]:
    problem = end.task.problem
    records = {record.run: record for record in problem.records}.values()
    messages = [
        *([end.note] if end.note else []),
        *_horizon(problem, end.search.solution.theta),
        *_inseparable_sums(end),
    ]
    for r in records:
        of_run = {"of_run": r.name} if len(records) > 1 else {}
        messages += [replace(message, figures={**message.figures, **of_run}) for message in r.notes]
    labelled_sums = list(zip(problem.labels, end.info.autocorrelation, strict=True))
    messages += [note("residual.not-white", subject=label) for label, c in labelled_sums if c > WHITE_LIMIT]
    messages += [note("residual.alternates", subject=label) for label, c in labelled_sums if c < -WHITE_LIMIT]
    return tuple(messages)


def _inseparable_sums(end: FinishedFit) -> list[Diagnostic]:
    """Return notes on sums whose two terms a run cannot separate: two delays, or a tilt and a bias."""
    shape, blocks = end.task.problem.shape, end.blocks.sensors._asdict().items()
    tilted_names = [
        name for name, block in blocks
        if has_field(block, "tilt_rad") and not _has_path(shape.shared_paths, f"sensors.{name}.tilt_rad")
        and _has_path(shape.paths, f"sensors.{name}.accel_bias")
    ]  # fmt: skip
    without_filter = [name for name, block in blocks if not getattr(block, "has_low_pass", True)]
    has_two_delays = DELAY_PATH in shape.shared_paths and len(without_filter) == len(blocks)
    notes = [note("delay.sum", subject=name) for name in (without_filter[:1] if has_two_delays else [])]
    return notes + [note("bias.tilt-sum", subject=name) for name in tilted_names]


def _has_path(paths: tuple[str, ...], key: str) -> bool:
    return any(path.partition("[")[0] == key for path in paths)


def _horizon(problem: Residuals, theta: np.ndarray) -> list[Diagnostic]:
    """Return notes on the time and the distance over which model and truth were compared."""
    if TRUTH not in problem.names:
        return []
    column, pose = problem.spans[TRUTH].start, any(i >= 3 for i in problem.shape.start)
    spans, lengths_m = [], []
    for record, h, mask in zip(problem.records, problem.predictions(theta), problem.masks, strict=True):
        rows = np.flatnonzero(mask[:, column] > 0.0)
        h, span = (h[rows[rows >= record.lead], column : column + 2], record.dt_s[record.lead :].sum())
        spans.append(span)
        lengths_m.append(np.hypot(*np.diff(h, axis=0).T).sum() if pose else span * np.hypot(*h.T).mean())
    code = "truth.horizon-of-pieces" if problem.layout.has_split_runs else "truth.horizon"
    span_s, distance_m = float(np.median(spans)), float(np.median(lengths_m))
    horizon = note(code, subject=TRUTH, span_s=span_s, distance_m=distance_m)
    return [horizon, *_mount_notes(problem, theta)]


def _mount_notes(problem: Residuals, theta: np.ndarray) -> list[Diagnostic]:
    """Return a note on a fitted position of the mark, which belongs to the map and not to the vehicle file."""
    pairs = zip(problem.shape.shared_paths, theta, strict=False)
    values = ", ".join(
        f"{path.removeprefix(MOUNT_PREFIX)} = {x:.4g}" for path, x in pairs if path.startswith(MOUNT_PREFIX)
    )
    return [note("truth.mount", subject=TRUTH, keys=values)] if values else []


def _fitted_blocks(end: FinishedFit) -> FittedBlocks:
    """Return the blocks with the estimates; biases are the mean over the runs."""
    problem, theta = end.task.problem, end.search.solution.theta
    shape, layout, s = problem.shape, problem.layout, len(problem.shape.shared_paths)
    means = theta[s : layout.first_start].reshape(layout.run_count, -1).mean(axis=0)[: len(shape.per_run)]
    return substitute(end.blocks, shape.paths, [float(x) for x in (*theta[:s], *means)])
