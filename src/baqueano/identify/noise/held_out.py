"""Decide on held-out runs: which accelerometers correct the speed, and if the noise of a filter is correct.

    r = √(Σ_b e_b² / Σ_b ẽ_b²),   speed errors e with a channel, ẽ without, b blocks of SPEED_BLOCK_S      (1)
    NIS_c = Σ_t y_c² / S_cc / N   over readings of channel c in the held-out runs, 1 if the noise is correct (2)
    NEES_s = Σ_t e_s² / P_ss / N  of state s over drives of the fitted vehicle with this noise               (3)

An accelerometer measures ν̇ and ν_x ν_ψ. A filter that corrects its speed by it is better than the model if both
terms are correct for the vehicle. It is worse if tilt, misalignment or tyres make them wrong. The sensors on board do
not show which case applies; a reference of the speed does (1). y are the innovations of the filter with covariance S,
limited to ROBUST_SIGMA standard deviations. Innovations of a real vehicle are not white, so the interval of (2) comes
from blocks of BLOCK_S, drawn with replacement. Each drive of (3) is one block (simulate/assumed_noise.py).
"""

from collections.abc import Callable, Iterator, Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.estimators.augmented.state import FORWARD_STATES, SCALE_INDEX, layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.readings.velocity_readings import velocity_readings
from baqueano.identify.noise.filter_noise import ROBUST_SIGMA
from baqueano.messages.language import mark as N_
from baqueano.numerics.statistics import MIN_BLOCKS, block_ratio
from baqueano.runs.filter_ticks import example_filter_tick, make_ticks
from baqueano.runs.interpolation import true_speed
from baqueano.runs.run import Run
from baqueano.signals import Tick, seconds
from baqueano.simulate.assumed_noise import simulated_errors
from baqueano.symbolic import scan
from baqueano.symbolic.scan import Scan

SPEED_BLOCK_S = 10.0
FORWARD = 0  # the entry of ν
BLOCK_S = 2.0  # longer than innovations are correlated
CLOSE_FACTOR = 1.2  # factor on a variance: a smaller error does not degrade a filter
DRIVE_CLOSE_FACTOR = 1.5  # on the variance of a state, because consider scales and slips are partly nonlinear
STATES = ("x", "y", N_("heading"), "v_x", "v_y", N_("yaw rate"))


class SpeedChannels(NamedTuple):
    """The channels that should correct the speed, and the reason."""

    names: tuple[str, ...]  # for `speed_from`: "imu[1]"; empty if no channel helps
    message: Diagnostic
    is_from_held_out: bool = True  # False: the names are from the file


def speed_channels(
    filters: Callable[[tuple[str, ...]], AugmentedEkf],
    file_names: tuple[str, ...],
    validation_runs: Sequence[Run],
    backend: str = "auto",
) -> SpeedChannels | None:
    """Return the channels that should correct the speed, or None for a filter without accelerometers. (1)
    `filters(channels)` returns the filter with `channels` in its field `speed_from`, and with its noise estimated
    again. `file_names` are the channels in the vehicle file; they are returned if no run shows the speed, or if all
    are too short. Each channel, and all together, are tested. The channel with the least r is used if its whole
    interval is below 1. The reference is the truth of the run, or else a sensor of speed that the estimator does not
    use."""
    wheel_filter = filters(())
    channels = tuple(_undecided_channels(wheel_filter))
    if not channels:
        return None
    references = [(run, *_reference_speed(run, wheel_filter)) for run in validation_runs]
    speed_runs = [(run, speed, source) for run, speed, source in references if speed is not None]
    if not speed_runs:
        code = "speed.by-the-file" if file_names else "speed.by-the-model"
        message = note(code, fix="--held-out RUN", channels=file_names, origin=_origin(wheel_filter))
        return SpeedChannels(file_names, message, is_from_held_out=False)
    wheel_errors, ratios = _errors(wheel_filter, speed_runs, backend), {}
    if not np.isfinite(wheel_errors).all():
        return None  # the model itself diverges
    source = ", ".join(sorted({source for *_, source in speed_runs}))
    runs = ", ".join(run.name for run, *_ in speed_runs)
    if len(wheel_errors) < MIN_BLOCKS:
        pieces = {"pieces": len(wheel_errors), "minimum": MIN_BLOCKS, "block_s": SPEED_BLOCK_S}
        return SpeedChannels(file_names, note("speed.too-short", runs=runs, **pieces), is_from_held_out=False)
    for names in dict.fromkeys([*((channel,) for channel in channels), channels]):
        errors = _errors(filters(names), speed_runs, backend)
        if np.isfinite(errors).all():
            ratios[names] = block_ratio(errors, wheel_errors)
    if not ratios:
        return None  # every filter diverges
    best_names = min(ratios, key=lambda names: ratios[names][0])
    ratio, low, high = ratios[best_names]
    details = {"channels": best_names, "ratio": ratio, "low": low, "high": high}
    details |= {"reference": source, "runs": runs}
    if high < 1.0:
        return SpeedChannels(best_names, note("speed.corrected", **details))
    return SpeedChannels((), note("speed.left", **details, origin=_origin(wheel_filter)))


def _origin(ekf: AugmentedEkf) -> Diagnostic:
    """Return a note with the sensors that measure the speed without an accelerometer, or with the model."""
    channels = zip(layout(ekf).channel_entries, layout(ekf).correction_mask(FORWARD_STATES[0]), strict=True)
    sensors = list(dict.fromkeys(name for (name, _), corrects in channels if corrects))
    return note("speed.of-sensors", sensors=sensors) if sensors else note("speed.of-the-model")


def _undecided_channels(ekf: AugmentedEkf) -> Iterator[str]:
    """Yield the inertial channels in use that do not correct the motion yet, as candidates for the speed."""
    filter_layout = layout(ekf)
    bias_sensors = {bias.sensor for bias in filter_layout.biases}
    for (name, i), E in zip(filter_layout.channel_entries, filter_layout.moving_mask, strict=True):
        if name in bias_sensors and not np.any(E[:SCALE_INDEX]):
            yield f"{name}[{i}]"


def _reference_speed(run: Run, ekf: AugmentedEkf) -> tuple[np.ndarray | None, str]:
    """Return the speed (N,) at the ticks from a source that the estimator does not use, and its name, or (None, "")."""
    if run.truth is not None and np.isfinite(speed := true_speed(run.t_ns, run.truth)).any():
        return speed, N_("the truth")
    used_names = set(layout(ekf).names)
    for name in getattr(ekf.sensors, "_fields", ()):
        readings = [r for r in velocity_readings(ekf.sensors, (name,)) if FORWARD in r.entries]
        channel = run.sensors.get(name)
        if name in used_names or channel is None or not readings or len(channel.t_ns) < 2:
            continue
        z = channel.z[:, list(readings[0].rows)]
        is_finite = np.isfinite(z).all(axis=1)
        speed = (z[is_finite] - readings[0].at_rest) @ readings[0].inverse[FORWARD]
        return np.interp(run.t_s, seconds(channel.t_ns[is_finite], run.t_ns[0]), speed, np.nan, np.nan), name
    return None, ""


def _errors(ekf: AugmentedEkf, runs: Sequence[tuple[Run, np.ndarray, str]], backend: str) -> np.ndarray:
    """Return the sums of squares (B,) of the speed errors over the blocks of all runs."""

    def step(belief: Tree, tick: Tick) -> tuple[Tree, Tree]:
        belief, estimate = ekf.row(belief, tick)
        return belief, estimate.nu[FORWARD]

    square_sums = []
    for run, speed, _ in runs:
        start = float(speed[0]) if np.isfinite(speed[0]) else 0.0
        ticks = make_ticks(run, ekf, len(run.t_ns))
        belief = ekf.init(nu=np.array([start, 0.0, 0.0]))
        kernel = scan(step, belief, example_filter_tick(ekf), backend=backend)
        nu_x = np.asarray(kernel.run(ticks)[1])[np.searchsorted(ticks.t_ns, run.t_ns)]
        is_finite = np.isfinite(speed)
        square = np.where(np.isfinite(nu_x), (nu_x - speed) ** 2, np.inf)  # a filter that diverges
        block = (run.t_s // SPEED_BLOCK_S).astype(int)
        sums, count = (np.bincount(block[is_finite], x[is_finite]) for x in (square, np.ones(len(square))))
        square_sums.append(sums[count > 0])
    return np.concatenate(square_sums)


class NoiseVerdict(StrEnum):
    """Verdict on the noise of a filter."""

    CONSISTENT = "true"
    TOO_SURE = "too sure"
    TOO_CAREFUL = "too cautious"
    CANNOT_TELL = "cannot tell"


class NormalisedSquare(NamedTuple):
    """The NIS of a channel or the NEES of a state, with its 95 % interval."""

    name: str  # "imu[2]", "heading"
    mean: float
    low: float  # NaN with too few blocks
    high: float
    close_factor: float  # factor within which the mean agrees with 1

    @property
    def verdict(self) -> NoiseVerdict:
        """Return the verdict on the noise."""
        if not np.isfinite(self.low):
            return NoiseVerdict.CANNOT_TELL
        if self.low > self.close_factor:
            return NoiseVerdict.TOO_SURE
        return NoiseVerdict.TOO_CAREFUL if self.high < 1.0 / self.close_factor else NoiseVerdict.CONSISTENT

    @property
    def is_inconsistent(self) -> bool:
        """Return True if the filter is overconfident or conservative."""
        return self.verdict in (NoiseVerdict.TOO_SURE, NoiseVerdict.TOO_CAREFUL)


class Acceptance(NamedTuple):
    """Verdict of held-out runs on the noise that is written."""

    message: Diagnostic
    is_inconsistent: bool  # True if the noise still disagrees after the new estimate, or on simulated drives


def validate_noise(
    ekf: AugmentedEkf, refit: Callable[[], AugmentedEkf], validation_runs: Sequence[Run], backend: str
) -> tuple[AugmentedEkf, Acceptance]:
    """Return the filter whose noise is written, and the verdict. The filter is `ekf` if the `validation_runs` agree
    with it or are too short for a test, else `refit()`, with the noise over all runs: the runs of the fit then do not
    show the noise of this vehicle. A channel agrees if its interval contains a value from 1/CLOSE_FACTOR to
    CLOSE_FACTOR, a state within DRIVE_CLOSE_FACTOR. Channels that still disagree are reported."""
    runs, kernel = ", ".join(run.name for run in validation_runs), _filter_scan(ekf, backend)
    squares = channel_nis(ekf, validation_runs, kernel)
    decisive = [square for square in squares if square.verdict != NoiseVerdict.CANNOT_TELL]
    if not decisive:
        return ekf, Acceptance(note("noise.too-short", runs=runs), False)
    contradictions, code = [square for square in decisive if square.is_inconsistent], "noise.consistent"
    figures: JsonObject = {"runs": runs, "nis": _figures(decisive)}
    if contradictions:
        ekf, code = refit(), "noise.estimated-again"
        kernel, names = _filter_scan(ekf, backend), {square.name for square in contradictions}
        squares = channel_nis(ekf, validation_runs, kernel)
        rejected_squares = [square for square in squares if square.name in names or square.is_inconsistent]
        figures |= {"nis": _figures(contradictions), "new_nis": _figures(rejected_squares)}
        if other_squares := [square for square in rejected_squares if square.is_inconsistent]:
            figures |= {"states": _consistency_notes(other_squares)}
            return ekf, Acceptance(note("noise.still-inconsistent", Severity.WARNING, **figures), True)
    nees = state_nees(ekf, validation_runs[0], kernel)
    if disagreeing_states := [square for square in nees if square.is_inconsistent]:
        figures = {"nees": _figures(nees), "states": _consistency_notes(disagreeing_states)}
        return ekf, Acceptance(note("noise.nees-inconsistent", Severity.WARNING, **figures), True)
    if nees and not contradictions:
        code, figures = "noise.consistent-in-simulation", figures | {"nees": _figures(nees)}
    return ekf, Acceptance(note(code, **figures), False)


def channel_nis(ekf: AugmentedEkf, runs: Sequence[Run], kernel: Scan) -> list[NormalisedSquare]:
    """Return the NIS of each channel that corrects the motion, in the order of the layout.  (2)"""
    filter_layout = layout(ekf)
    names = [f"{name}[{i}]" for name, i in filter_layout.channel_entries]
    squares, counts = [], []
    for run in runs:
        ticks = make_ticks(run, ekf, len(run.t_ns))
        square = np.asarray(kernel.run(ticks)[1][0])
        is_present = np.isfinite(square)
        block = (seconds(ticks.t_ns, int(ticks.t_ns[0])) // BLOCK_S).astype(int)
        square = np.minimum(np.where(is_present, square, 0.0), ROBUST_SIGMA**2)
        squares.append(np.stack([np.bincount(block, column) for column in square.T], axis=1))
        counts.append(np.stack([np.bincount(block, column) for column in is_present.T], axis=1))
    square, count = np.concatenate(squares), np.concatenate(counts)
    return [
        _normalised_square(names[k], square[:, k], count[:, k], CLOSE_FACTOR)
        for k in np.flatnonzero(filter_layout.corrects_motion)
    ]


def state_nees(ekf: AugmentedEkf, run: Run, kernel: Scan) -> list[NormalisedSquare]:
    """Return the NEES of each state on drives like `run`, or an empty list if they cannot be simulated.  (3)"""
    e, P = simulated_errors(ekf, run, kernel)
    square = e**2 / np.diagonal(P, axis1=2, axis2=3)
    count = np.full(len(square), float(square.shape[1]))
    return [
        _normalised_square(name, square[:, :, k].sum(axis=1), count, DRIVE_CLOSE_FACTOR)
        for k, name in enumerate(STATES if len(square) else ())
    ]


def _filter_scan(ekf: AugmentedEkf, backend: str) -> Scan:
    """Return a scan of the filter whose outputs are y²/S (m,), η, ν and the covariance."""

    def step(belief: Tree, tick: Tick) -> tuple[Tree, Any]:
        belief, estimate = ekf.row(belief, tick)
        y, S = estimate.innovation, estimate.innovation_cov
        assert y is not None
        assert S is not None
        return belief, (y**2 / np.diagonal(S), estimate.eta, estimate.nu, estimate.cov)

    return scan(step, ekf.init(), example_filter_tick(ekf), backend=backend)


def _normalised_square(
    name: str, square: np.ndarray, count: np.ndarray, close_factor: float
) -> NormalisedSquare:
    mask, (mean, low, high) = count > 0.0, (float("nan"),) * 3
    if mask.any():
        mean, low, high = block_ratio(square[mask], count[mask])
    return NormalisedSquare(name, mean**2, low**2, high**2, close_factor)


def _consistency_notes(squares: Sequence[NormalisedSquare]) -> list[Diagnostic]:
    """Return the channels or states for which the filter is overconfident, and those for which it is conservative."""
    codes = {NoiseVerdict.TOO_SURE: "noise.too-small-for", NoiseVerdict.TOO_CAREFUL: "noise.too-large-for"}
    return [
        note(code, states=[note("noise.state", name=square.name) for square in group])
        for verdict, code in codes.items()
        if (group := [square for square in squares if square.verdict == verdict])
    ]


def _figures(noise: Sequence[NormalisedSquare]) -> list[Diagnostic]:
    return [
        note("noise.square", name=square.name, mean=square.mean, low=square.low, high=square.high)
        for square in noise
    ]
