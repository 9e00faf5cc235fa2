"""Find the identifiable parameters by the information matrix, and repeat the search with the others fixed.

    C_ij = A_ij / √(A_ii A_jj)                   information in units of each parameter's own effect      (1)
    s_i  = √((E_c − 30) / A_ii^c)                the change of θ_i that is as large as a signal itself    (2)

A_ii^c is the information of the channel c with the most information on θ_i; E_c is the energy of its predicted
signal. Both are in standard deviations of the noise; 30 is the largest energy of a fit to noise only. A direction v
with C v ≈ 0 does not change any measurement. Then one of its parameters is fixed, preferably a parameter that scale
or tape can measure. Of two starts, the start with less information is fixed. Parameters with an error above
`BLIND_RATIO` s_i, or half the span of their bounds, are also fixed. A scale is fixed if its error is above
`SCALE_STD`, the error in its data sheet. A parameter with an error above `WEAK_VALUE` of its value and `WEAK_SIGNAL`
of (2) is poorly identified. At a bound it is fixed if its start is within `MAX_START_SIGMA` standard errors. Its
variance is Σ_j v_ij²/λ_j. It can be confused with parameters that have `MEMBER_LOADING` of the largest entry in the
direction v_j of C with most of this variance. An effect that no run can show is reported once.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.covariance.information import (
    FixedParameters,
    Information,
    UncertainParameters,
    joint_information,
    parameter_cov,
)
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.parameters.free import DELAY_PATH, FreeParameter
from baqueano.identify.parameters.theta import Parameters
from baqueano.identify.residuals.simulation import Residuals
from baqueano.numerics.parallel import parallel_map
from baqueano.sensors.imu import SCALE_TOLERANCE
from baqueano.sensors.sampling import measures_pose
from baqueano.vehicles.drivetrain import LARGEST_DELAY_S
from baqueano.vehicles.freedoms import AXIS_NAMES

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

SINGULAR_EIGENVALUE = 1e-9  # fraction of the largest eigenvalue of C, below which a direction is unobservable
BLIND_RATIO = 0.5
NOISE_ENERGY = 30.0  # largest energy that a model without motion fits to the noise, 5 σ of one value
SCALE_STD = SCALE_TOLERANCE / 3.0**0.5  # σ of a scale by its data sheet
WEAK_VALUE = 0.3
WEAK_SIGNAL = 0.02
MIN_LOADING = 0.01  # least part of the largest entry, for a parameter that is fixed to resolve a direction
MAX_START_SIGMA = 1.0  # standard errors from a bound to a start that the data do not contradict
MEMBER_LOADING = 0.3  # part of the largest entry of a direction, above which a parameter belongs to it


class Identifiability(NamedTuple):
    """Identifiable, poorly identified, collinear and correlated entries of θ."""

    mask: np.ndarray  # (p,) bool: entries of θ that the data determine
    poorly_identified: np.ndarray  # (p,) bool: identifiable, but with a large error
    collinear: dict[int, tuple[int, ...]]  # a fixed entry → the entries that it is collinear with
    correlated: dict[int, tuple[int, ...]] = {}  # noqa: RUF012  a weak or fixed entry → the entries with which it is confused


def assess_identifiability(
    info: Information,
    signal_energy: np.ndarray,
    theta: np.ndarray,
    shared_parameters: Sequence[FreeParameter],
    is_fixed: np.ndarray,
    span: np.ndarray,
) -> Identifiability:
    """Return the identifiability of the entries of θ (p,). The first entries are `shared_parameters` of the vehicle.
    `signal_energy` (m,) belongs to the channels. `is_fixed` (p,) is a mask of entries that are already fixed;
    `span` (p,) is the distance between the bounds."""

    def entry_mask(test: Callable[[FreeParameter], bool]) -> np.ndarray:
        mask = np.zeros(len(theta), bool)
        mask[: len(shared_parameters)] = [test(parameter) for parameter in shared_parameters]
        return mask

    is_vehicle_entry = entry_mask(lambda p: True)
    is_hand_measured = entry_mask(lambda p: p.definition.measured_by != "")
    is_identifiable, collinear, partners = ~is_fixed & (np.diagonal(info.bread) > 0.0), {}, {}
    signal = _signal_scale(info.channel_information, signal_energy)
    while is_identifiable.any():
        direction = _unobservable_direction(info.bread, is_identifiable)
        if direction is None:
            break
        loadings = np.abs(direction) / np.max(np.abs(direction))
        main_entries = np.flatnonzero(loadings >= MEMBER_LOADING).tolist()
        members, diagonal = np.flatnonzero(loadings >= MIN_LOADING), np.diagonal(info.bread)
        start_rank = np.where(is_vehicle_entry, 0.0, -diagonal)
        rank = {int(i): (is_hand_measured[i], round(loadings[i], 1), start_rank[i]) for i in members}
        entry = max(rank, key=rank.__getitem__)
        collinear[entry] = tuple(i for i in main_entries if i != entry)
        is_identifiable[entry] = False
    # a bound of the integrator does not limit the effect that the equations can have
    weak_signal = np.where(entry_mask(lambda p: p.is_numerical_bound), signal, np.minimum(signal, span))
    signal = np.minimum(signal, span)
    is_scale = entry_mask(lambda p: p.definition.role == "scale")
    signal, weak_signal = (
        np.where(is_scale, np.minimum(x, SCALE_STD / BLIND_RATIO), x) for x in (signal, weak_signal)
    )
    is_weak = np.zeros(len(theta), bool)
    while is_identifiable.any():
        index = np.flatnonzero(is_identifiable)
        std = np.sqrt(np.diagonal(parameter_cov(info, index)))
        excess = np.where(is_vehicle_entry[index], std - BLIND_RATIO * signal[index], -1.0)
        if not np.any(excess > 0.0):
            is_large = (std > WEAK_VALUE * np.abs(theta[index])) & (std > WEAK_SIGNAL * weak_signal[index])
            is_weak[index] = is_large & is_vehicle_entry[index]
            for k in np.flatnonzero(is_weak).tolist():
                partners[k] = _correlated_entries(info.bread, is_identifiable & is_vehicle_entry, k)
            break
        ratio = std / np.maximum(signal[index], 1e-9 * std)
        entry = int(index[np.argmax(np.where(excess > 0.0, ratio, -1.0))])
        partners[entry] = _correlated_entries(info.bread, is_identifiable & is_vehicle_entry, entry)
        is_identifiable[entry] = False
    return Identifiability(is_identifiable, is_weak, collinear, partners)


def _directions(A: np.ndarray, identifiable: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the indices of the entries `identifiable`, and the eigenvalues and eigenvectors of their C.  (1)"""
    index = np.flatnonzero(identifiable)
    root = 1.0 / np.sqrt(np.diagonal(A)[index])
    values, vectors = np.linalg.eigh(A[np.ix_(index, index)] * np.outer(root, root))
    return index, values, vectors


def _correlated_entries(A: np.ndarray, identifiable: np.ndarray, k: int) -> tuple[int, ...]:
    """Return the other entries of the direction that contains most of the variance of entry k."""
    index, values, vectors = _directions(A, identifiable)
    row = vectors[int(np.searchsorted(index, k))]
    v = np.abs(vectors[:, np.argmax(row**2 / np.maximum(values, 1e-12 * values[-1]))])
    return tuple(int(i) for i in index[v >= MEMBER_LOADING * v.max()] if i != k)


def _unobservable_direction(A: np.ndarray, identifiable: np.ndarray) -> np.ndarray | None:
    """Return v (p,) with C v ≈ 0 among the entries `identifiable`, or None.  (1)"""
    index, values, vectors = _directions(A, identifiable)
    if values[0] > SINGULAR_EIGENVALUE * values[-1]:
        return None
    v = np.zeros(len(A))
    v[index] = vectors[:, 0]
    return v


def _signal_scale(by_channel: np.ndarray, signal_energy: np.ndarray) -> np.ndarray:
    """Return s (p,), the change of each parameter that is as large as a signal.  (2)"""
    best_channel = np.argmax(by_channel, axis=0)
    info = np.maximum(by_channel[best_channel, np.arange(by_channel.shape[1])], 1e-300)
    return np.sqrt(np.maximum(signal_energy[best_channel] - NOISE_ENERGY, 0.0)) / np.sqrt(info)


def fix_unidentifiable(
    task: Task, end: Search, free: Sequence[FreeParameter], uncertain: UncertainParameters
) -> tuple[Search, Identifiability, Information, Information]:
    """Repeat the search until all unidentifiable entries of θ are fixed at their start. Return the search, the
    identifiability, the information, and that with the `uncertain` parameters. `free` are the first entries of θ.

    The start of a fixed entry can drive an entry with which it is confused to its bound. Then that entry is fixed
    instead. Otherwise the rest of the error would bias the other parameters. A poorly identified entry at a bound is
    fixed too, if its start is within MAX_START_SIGMA standard errors.
    """
    problem = end.problem
    is_split = problem.layout.has_split_runs
    # the starts of segments are nuisance parameters
    count = problem.layout.first_start if is_split else problem.size
    is_fixed, collinear, partners = np.zeros(count, bool), {}, {}
    released_entry: int | None = None  # an entry that was fixed first, and the result with it
    first_result: tuple[Search, Identifiability, Information, Information] | None = None
    while True:
        problem, theta = end.problem, end.solution.theta
        joint_info = joint_information(problem, theta, uncertain)
        s, added_count = problem.layout.shared_count, len(uncertain.added_paths(problem))
        info = joint_info.part(np.r_[:s, s + added_count : count + added_count])
        by_channel = info.channel_information
        if task.prior_sigma is not None:  # a hand measurement does not have a signal to compare with
            by_channel = by_channel * (task.prior_sigma == 0.0)[:, None]
        info = info._replace(channel_information=by_channel, shared_count=count)
        span = (task.high - task.low)[:count]
        span[[k for k, parameter in enumerate(free) if parameter.path == DELAY_PATH]] = np.inf
        identifiability = assess_identifiability(
            info, signal_energy(problem, theta), theta[:count], free, is_fixed, span
        )
        collinear |= identifiability.collinear
        partners |= identifiability.correlated | identifiability.collinear
        if first_result is not None and not identifiability.mask[released_entry]:
            return first_result
        if (near_start := _entry_near_start(task, theta, info, identifiability, free)) is not None:
            identifiability = identifiability._replace(
                mask=identifiability.mask & (np.arange(count) != near_start)
            )
        if np.array_equal(~identifiability.mask, is_fixed):
            result = end, identifiability._replace(collinear=collinear), info, joint_info
            pair = None if first_result else _bounded_pair(task, theta, is_fixed, partners, free)
            if pair is None:
                return result
            first_result, (released_entry, at_bound) = result, pair
            is_fixed[[released_entry, at_bound]] = False, True
        else:
            is_fixed = ~identifiability.mask
        is_held_fixed = np.concatenate([is_fixed, np.zeros(problem.size - count, bool)])
        second_search = search(task, np.where(is_held_fixed, task.start, theta), is_held_fixed, end)
        end = second_search._replace(evaluations=end.evaluations + second_search.evaluations)


def _entry_near_start(
    task: Task,
    theta: np.ndarray,
    info: Information,
    identifiability: Identifiability,
    free: Sequence[FreeParameter],
) -> int | None:
    """Return the poorly identified entry at a bound that is the fewest standard errors from its start; None if all are
    further than MAX_START_SIGMA."""
    weak_entries = np.flatnonzero(identifiability.poorly_identified).tolist()
    candidates = [k for k in weak_entries if _left_its_start(task, theta, k, free)]
    if not candidates:
        return None
    index = np.flatnonzero(identifiability.mask)
    std = np.ones(len(identifiability.mask))
    std[index] = np.sqrt(np.diagonal(parameter_cov(info, index)))
    sigmas = {k: abs(task.start[k] - theta[k]) / std[k] for k in candidates}
    entry = min(sigmas, key=sigmas.__getitem__)
    return entry if sigmas[entry] < MAX_START_SIGMA else None


def _left_its_start(task: Task, theta: np.ndarray, k: int, free: Sequence[FreeParameter]) -> bool:
    """Return True if an entry of θ is at a bound and began inside its bounds. A delay does not count."""
    is_at_bound = theta[k] <= task.low[k] or theta[k] >= task.high[k]
    return bool(is_at_bound and task.low[k] < task.start[k] < task.high[k]) and free[k].path != DELAY_PATH


def _bounded_pair(
    task: Task, theta: np.ndarray, is_fixed: np.ndarray, partners: Mapping[int, Sequence[int]],
    free: Sequence[FreeParameter],
) -> tuple[int, int] | None:  # fmt: skip
    """Return a fixed entry of θ and one of its `partners` at a bound, both of `free`, but not a delay; or None."""
    for i in np.flatnonzero(is_fixed[: len(free)]).tolist():
        for j in partners.get(i, ()):
            if j < len(free) and not is_fixed[j] and _left_its_start(task, theta, j, free):
                return i, j
    return None


def signal_energy(problem: Residuals, theta: np.ndarray) -> np.ndarray:
    """Return the energy (m,) of the prediction of each channel about its mean, in standard deviations of the noise. The
    mean is taken over all rows, or over each segment if a parameter of the segment or run can explain it."""

    def channel_sums(r: np.ndarray, z: np.ndarray, mask: np.ndarray, weight: np.ndarray) -> np.ndarray:
        h = (z * weight - r) * mask
        return np.array([np.einsum("tc,tc->c", h, h), np.einsum("tc->c", h), np.einsum("tc->c", mask)])

    segments = problem.residuals(theta), problem.z, problem.masks, problem.weights
    sums = np.array(parallel_map(channel_sums, *segments, rows=sum(map(len, problem.z))))
    square, total, count = sums.transpose(1, 0, 2)  # (segments, m) each
    segment_means = np.sum(total**2 / np.maximum(count, 1.0), axis=0)
    common_mean = np.sum(total, axis=0) ** 2 / np.maximum(np.sum(count, axis=0), 1.0)
    return np.sum(square, axis=0) - np.where(has_one_mean(problem), common_mean, segment_means)


def has_one_mean(problem: Residuals) -> np.ndarray:
    """Return a mask (m,), True for channels whose mean is not explained by a start, a bias, or a position."""
    by_run = {name.split(".")[1] for name in problem.shape.by_run}
    sensors = problem.blocks.sensors._asdict()
    has_start = bool(problem.shape.start)
    is_explained = [has_start or name in by_run or measures_pose(sensors[name]) for name in problem.names]
    return np.repeat(~np.array(is_explained, bool), problem.sizes)


class FinishedFit(NamedTuple):
    """State of a fit after the search."""

    vehicle_file: "VehicleFile"
    parameters: Parameters
    task: Task
    search: Search
    identifiability: Identifiability
    info: Information
    fixed: FixedParameters
    note: Diagnostic | None = None  # on changes before the search
    findings: tuple[Diagnostic, ...] = ()  # about the data
    score_test: bool = True  # True to test for effects that the model lacks
    is_explained_by_floor: bool = False  # True if process noise explains the residuals of the simulation
    is_filtered: bool = False  # True if θ comes from the innovations

    @property
    def blocks(self) -> FittedBlocks:
        """Return the model and the sensors, with the values of the file."""
        return self.parameters.blocks

    def confused_parameters(self, partners: Mapping[int, tuple[int, ...]], i: int) -> list[FreeParameter]:
        """Return the shared parameters among the `partners` of entry i of θ, a field of `identifiability`."""
        free = self.parameters.free
        return [free[j] for j in partners.get(i, ()) if j < len(free)]


MAX_NAMES = 4  # names in one message
WARNING = Severity.WARNING


def weak_reason(parameter: FreeParameter, similar_parameters: Sequence[FreeParameter]) -> Diagnostic:
    """Return the reason for the large error of a parameter, and the motion that would reduce it."""
    code = "identifiability.poor-pair" if similar_parameters else "identifiability.poor"
    return note(code, WARNING, subject=parameter.path, **_explanation(parameter, similar_parameters))


def _explanation(parameter: FreeParameter, similar_parameters: Sequence[FreeParameter]) -> JsonObject:
    """Return the parameters that are confused with `parameter`, the reason, and the missing motion."""
    figures = {"others": _names(similar_parameters)} if similar_parameters else {}
    return figures | {
        "reason": _motion_note((parameter, *similar_parameters)),
        "advice": _needed_motion(parameter),
    }


def unobservable_reason(
    parameter: FreeParameter,
    collinear: Sequence[FreeParameter],
    value: float,
    similar_parameters: Sequence[FreeParameter],
) -> Diagnostic:
    """Return the reason why a parameter is fixed at `value`, and the motion that would show it."""
    path = parameter.path
    if collinear:
        tool, names = parameter.definition.measured_by, _names(collinear)
        separation = _separation((parameter, *collinear))
        remedy = note("identifiability.measure", tool=tool) if tool else note("identifiability.fix-one")
        return note(
            "identifiability.collinear", subject=path, others=names, value=value, advice=remedy, motion=separation
        )  # fmt: skip
    if parameter.definition.role == "scale":
        return note("identifiability.scale", subject=path, value=value, advice=_needed_motion(parameter))
    code = "identifiability.fixed-pair" if similar_parameters else "identifiability.fixed"
    return note(code, subject=path, value=value, **_explanation(parameter, similar_parameters))


def missing_command(parameters: Sequence[FreeParameter], command: str, is_unused: bool) -> Diagnostic:
    """Return the reason why the fit does not determine the column of `command` in the gain matrix, T or V."""
    names = _names(parameters)
    if is_unused and command == "u_y":
        return note("identifiability.no-sideways-command", subject=parameters[0].path, names=names)
    code = "identifiability.no-command" if is_unused else "identifiability.command-still"
    return note(code, subject=parameters[0].path, names=names, command=command)


def _names(parameters: Sequence[FreeParameter]) -> str:
    """Return the short names as text, at most MAX_NAMES."""
    names = [parameter.short_name for parameter in parameters[:MAX_NAMES]]
    return ", ".join(names + ["…"] * (len(parameters) > MAX_NAMES))


def _motion_note(parameters: Sequence[FreeParameter]) -> Diagnostic | str:
    """Return a note on the limited motion that does not separate the `parameters`, or ""."""
    axes = {parameter.axis for parameter in parameters if parameter.axis is not None}
    if axes == {1}:
        return note("identifiability.little-sideways")
    axis_terms = [p for p in parameters if p.axis is not None and p.definition.role != "gain"]
    frictions = {parameter.path.partition("[")[0] for parameter in axis_terms}
    if len(axes) == 1 and len(frictions) > 1:
        return note("identifiability.few-speeds") if axes == {0} else note("identifiability.few-turn-rates")
    return ""


def _separation(parameters: Sequence[FreeParameter]) -> Diagnostic | str:
    """Return a note with one or two motions that separate the `parameters`, or ""."""
    motions = [*dict.fromkeys(parameter.shown_by for parameter in parameters if parameter.shown_by)][:2]
    if len(motions) == 2:
        return note("identifiability.separate-by-two", first=motions[0], second=motions[1])
    return note("identifiability.separate", motion=motions[0]) if motions else ""


def _needed_motion(parameter: FreeParameter) -> Diagnostic:
    if fix := larger_bound(parameter.path, parameter.high):
        return note("identifiability.needs-bound", fix=fix, motion=parameter.shown_by, bound=parameter.high)
    if parameter.shown_by:
        return note("identifiability.needs", motion=parameter.shown_by)
    if parameter.definition.role == "gain" and parameter.definition.shape == (3, 3):
        row, column = (AXIS_NAMES[i] for i in parameter.entry)
        return note("identifiability.needs-command", command=column, motion=row)
    return note("identifiability.needs-run")


def larger_bound(path: str, bound: float) -> str:
    """Return the option for a larger bound of a delay; "" for another parameter, or at the bound of its field."""
    is_extensible = path == DELAY_PATH and bound < LARGEST_DELAY_S
    return f"--bound {path}=0,{round(min(2.0 * bound, LARGEST_DELAY_S), 3)}" if is_extensible else ""
