"""Choose the accelerometers that correct the speed: those that improve it on held-out runs.

An accelerometer measures ν̇ and ν_x ν_ψ. A filter that corrects its speed by it is better than the model if both
terms are correct for the vehicle. It is worse if the tilt, the misalignment or the tyres make them wrong. The sensors
on board do not show which case applies. So each channel, and all channels together, are tested on held-out runs in
which a reference shows the speed:

    r = √(Σ_b e_b² / Σ_b ẽ_b²),   e with the channel, ẽ without, b blocks of BLOCK_S                       (1)

The interval of r comes from blocks drawn with replacement. The channel with the least r is used if its whole interval
is below 1. The reference is the truth of the run, or else a sensor of speed that the estimator does not use.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.estimators.augmented.state import FORWARD_STATES, SCALE_INDEX, layout
from baqueano.estimators.augmented_ekf import AugmentedEkf
from baqueano.estimators.readings.velocity_readings import velocity_readings
from baqueano.messages.language import mark as N_
from baqueano.runs.filter_ticks import example_filter_tick, ticks_of
from baqueano.runs.interpolation import true_speed
from baqueano.runs.run import Run
from baqueano.signals import Tick, seconds
from baqueano.symbolic import scan

BLOCK_S = 10.0
MIN_BLOCKS = 5  # blocks, for an interval
DRAWS = 2000
FORWARD = 0  # the entry of ν


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
    are too short."""
    without_speed = filters(())
    channels = tuple(_undecided_channels(without_speed))
    if not channels:
        return None
    references = [(run, *_reference_speed(run, without_speed)) for run in validation_runs]
    with_speed = [(run, speed, source) for run, speed, source in references if speed is not None]
    if not with_speed:
        code = "speed.by-the-file" if file_names else "speed.by-the-model"
        message = note(code, fix="--held-out RUN", channels=file_names, origin=_origin(without_speed))
        return SpeedChannels(file_names, message, is_from_held_out=False)
    errors_without, ratios = _errors(without_speed, with_speed, backend), {}
    if not np.isfinite(errors_without).all():
        return None  # the model itself diverges
    source = ", ".join(sorted({source for *_, source in with_speed}))
    runs = ", ".join(run.name for run, *_ in with_speed)
    if len(errors_without) < MIN_BLOCKS:
        pieces = {"pieces": len(errors_without), "least": MIN_BLOCKS, "block_s": BLOCK_S}
        return SpeedChannels(file_names, note("speed.too-short", runs=runs, **pieces), is_from_held_out=False)
    for names in dict.fromkeys([*((channel,) for channel in channels), channels]):
        errors = _errors(filters(names), with_speed, backend)
        if np.isfinite(errors).all():
            ratios[names] = ratio_of_blocks(errors, errors_without)
    if not ratios:
        return None  # every filter diverges
    best_names = min(ratios, key=lambda names: ratios[names][0])
    ratio, low, high = ratios[best_names]
    details = {"channels": best_names, "ratio": ratio, "low": low, "high": high, "by": source, "runs": runs}
    if high < 1.0:
        return SpeedChannels(best_names, note("speed.corrected", **details))
    return SpeedChannels((), note("speed.left", **details, origin=_origin(without_speed)))


def _origin(ekf: AugmentedEkf) -> Diagnostic:
    """Return a note with the sensors that measure the speed without an accelerometer, or with the model."""
    corrects_speed = layout(ekf).moving_mask[:, FORWARD_STATES[0]] > 0.0
    channels = zip(layout(ekf).channel_entries, corrects_speed, strict=True)
    sensors = list(dict.fromkeys(name for (name, _), corrects in channels if corrects))
    return note("speed.of-sensors", sensors=sensors) if sensors else note("speed.of-the-model")


def ratio_of_blocks(ours: np.ndarray, reference: np.ndarray) -> tuple[float, float, float]:
    """Return the ratio of two root mean square errors, and its 95 % interval. `ours` and `reference` (B,) are sums of
    squares in B blocks. The interval is NaN with fewer than MIN_BLOCKS blocks. (1)"""
    ratio = float(np.sqrt(ours.sum() / reference.sum()))
    if len(ours) < MIN_BLOCKS:
        return ratio, float("nan"), float("nan")
    pick = np.random.default_rng(0).integers(0, len(ours), (DRAWS, len(ours)))
    low, high = np.quantile(np.sqrt(ours[pick].sum(axis=1) / reference[pick].sum(axis=1)), [0.025, 0.975])
    return ratio, float(low), float(high)


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
    names_used = set(layout(ekf).names)
    for name in getattr(ekf.sensors, "_fields", ()):
        readings = [one for one in velocity_readings(ekf.sensors, (name,)) if FORWARD in one.entries]
        channel = run.sensors.get(name)
        if name in names_used or channel is None or not readings or len(channel.t_ns) < 2:
            continue
        z = channel.z[:, list(readings[0].rows)]
        finite = np.isfinite(z).all(axis=1)
        speed = (z[finite] - readings[0].at_rest) @ readings[0].inverse[FORWARD]
        return np.interp(run.t_s, seconds(channel.t_ns[finite], run.t_ns[0]), speed, np.nan, np.nan), name
    return None, ""


def _errors(ekf: AugmentedEkf, runs: Sequence[tuple[Run, np.ndarray, str]], backend: str) -> np.ndarray:
    """Return the sums of squares (B,) of the speed errors over the blocks of all runs."""

    def step(belief: Tree, tick: Tick) -> tuple[Tree, Tree]:
        belief, estimate = ekf.row(belief, tick)
        return belief, estimate.nu[FORWARD]

    out = []
    for run, speed, _ in runs:
        start = float(speed[0]) if np.isfinite(speed[0]) else 0.0
        ticks = ticks_of(run, ekf, len(run.t_ns))
        belief = ekf.init(nu=np.array([start, 0.0, 0.0]))
        kernel = scan(step, belief, example_filter_tick(ekf), backend=backend)
        nu_x = np.asarray(kernel.run(ticks)[1])[np.searchsorted(ticks.t_ns, run.t_ns)]
        finite = np.isfinite(speed)
        square = np.where(np.isfinite(nu_x), (nu_x - speed) ** 2, np.inf)  # a filter that diverges
        block = (run.t_s // BLOCK_S).astype(int)
        sums, count = (np.bincount(block[finite], x[finite]) for x in (square, np.ones(len(square))))
        out.append(sums[count > 0])
    return np.concatenate(out)
