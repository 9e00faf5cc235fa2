"""A fit on runs that it has not seen: simulated from the commands alone, parameters as they are.

    e = z − h(θ̂),   error = √ mean e²,   explained = 1 − Σ e² / Σ (z − z̄)²                                 (1)
    noise² = mean e_own² + max(0, w² − w_own²),   w² = ½ mean (e_{k+1} − e_k)²                            (2)
    g_b = log mean_{block b} e²,   ḡ − ḡ_own > t_{1−α} s √(1/B + 1/B_own)   and   error² > 2 noise²        (3)
    g_b − ḡ_own > t_{1−α/B} s_own √(1 + 1/B_own)   and   mean_{block b} e² > 2 noise²                      (4)

What belongs to a run and not to the vehicle is found on the run itself, for nobody knows it before: the IMU's biases,
the velocity at the start, clocks and other numbers that the fit found run by run. Everything else is the fit's.

A share of the variance alone judges badly: where the own runs are explained to 99 %, 90 % are an error of three times
the size, and a run that hardly moved is explained by no model. So the error is held against what noise explains (2):
what the fit leaves of its own runs, sensor and floor together, and the white part by which this run is louder (w, von
Neumann's: vibration grows with speed, and no model takes it away). The model is said not to carry over where its own
part of e² is larger than that of the noise, and where that is no chance (3): blocks of BLOCK_S are as good as
independent (choose/held_out.py), s is the scatter of g over the blocks of both, and t Student's with its B + B_own − 2
degrees of freedom. A single block whose g lies beyond what the highest of B blocks reaches by chance (4) is told with
its time: something happened there. Where there are fewer than ENOUGH on either side, blocks have SHORT_S. A single
block on both sides tells nothing of chance, and the sentence says so. α is half of CHANCE, for each of the two.

Measured: where g scatters alike on both sides, by 0.3 to 1, at most 1.1 % of the channels are told, with 1 to 12
blocks a side (10,000 each). Of a small vehicle whose fit is that of two minutes, over a floor of 0.1 m/s and 0.3 rad/s
in 1 s, 2 of 1,500 channels of runs of 5 to 30 s. A fit of 22 parameters to 10 s alone is off by more on every second
run that follows: that is told, and is no chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.answer.channel_units import channel_unit
from baqueano.identify.answer.result import ChannelFit, Fit, asked_for
from baqueano.identify.batches import students
from baqueano.identify.choose.held_out import BLOCK_S, SHORT_S
from baqueano.identify.fit import identify
from baqueano.identify.rows.tape import KINDS
from baqueano.runs.run import Run

WORSE = 2.0  # of error² to noise²: above it more than half of the error is the model's
CHANCE = 0.01  # of a warning on one channel of one run, for a model that carries over
CLIPPED = 10.0  # noises beyond which an error counts no more: one spike is not the model's
LEAST = 10  # readings of a block that is counted
ENOUGH = 6  # blocks on both sides; where BLOCK_S makes fewer, they have SHORT_S


class Figure(NamedTuple):
    """One channel of one unseen run."""

    run: str
    channel: str
    error: float  # root mean square
    explained: float
    on_own_runs: float  # explained of the runs that the fit was made from
    unit: str = ""  # of error
    noise: float = float("nan")  # error that sensor and floor explain, by (2)

    @property
    def times(self) -> float:
        """The error in units of what noise explains: 1 for a perfect model."""
        return self.error / self.noise if self.noise > 0.0 else float("nan")


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
        return [figure._asdict() | {"times": figure.times} for figure in self.figures]

    def table(self) -> str:
        """For people."""
        lines = [
            f"{'held out':20} {'channel':14} {'error':>10}        {'of noise':>9} {'explained':>10} {'own runs':>10}"
        ]
        for f in self.figures:
            parts = f"{f.times:>8.2f}× {100 * f.explained:>9.1f}% {100 * f.on_own_runs:>9.1f}%"
            lines.append(f"{f.run:20} {f.channel:14} {f.error:>10.3g} {f.unit:6} {parts}")
        return "\n".join([*lines, f"{self.verdict}: {'; '.join(self.reasons) or 'the model carries over'}"])


class _Left(NamedTuple):
    """What is left of a channel."""

    square: float  # mean e²
    white: float  # w² of (2)
    g: np.ndarray  # (B,) log of the mean square of each block
    t_s: np.ndarray  # (B,) when it begins
    block_s: float = BLOCK_S


def judge(fit: Fit, runs: Run | Sequence[Run]) -> Judged:
    """`fit` on `runs`. UsageError where it was made from one of them, or was refused."""
    runs = [runs] if isinstance(runs, Run) else list(runs)
    if fit.verdict == "REFUSED":
        raise UsageError("the fit is refused, so there is nothing to judge: mend that first.")
    again = [run.name for run in runs if run.name in fit.runs]
    if again:
        raise UsageError(f"{again[0]} was fitted to, so it cannot judge. Give another run to --held-out.")
    use = _used(fit)
    sigma = {name: noise for name, noise in fit.sigma.items() if any(u.split("[")[0] == name for u in use)}
    own = [name for name in fit.own_names if asked_for(name)]
    clocks = [name.removeprefix("clock.") for name in own if name.startswith("clock.")]
    per_run = [name for name in own if not name.startswith("clock.")]
    channels: list[ChannelFit] = []
    file = fit.vehicle_file
    for run in runs:
        channels += identify(
            run,
            file,
            (),
            use=use,
            sigma=sigma,
            per_run=per_run,
            clocks=clocks,
            doubts=False,
            backend=fit.backend,
        ).channels
    figures, reasons = [], []
    for c in channels:
        if np.isfinite(c.measured - c.predicted).any() and np.isfinite(c.explained):
            own = [one for one in fit.channels if (one.sensor, one.entry) == (c.sensor, c.entry)]
            figure, said = _judged(c, own, channel_unit(file, c.sensor, c.entry))
            figures.append(figure)
            reasons += said
    return Judged(tuple(figures), tuple(channels), tuple(reasons))


def _used(fit: Fit) -> tuple[str, ...]:
    """What the fit believed, as `use` takes it; no tape lies in unseen runs."""
    told = dict.fromkeys((c.sensor, c.entry) for c in fit.channels if np.isfinite(c.explained))
    sensors = [name for name in fit.sigma if name not in KINDS]
    whole = [name for name in sensors if all((name, k) in told for k in range(len(fit.sigma[name])))]
    return (*whole, *(f"{name}[{k}]" for name, k in told if name in sensors and name not in whole))


def _judged(c: ChannelFit, own: Sequence[ChannelFit], unit: str) -> tuple[Figure, list[str]]:
    """The figures of one channel of an unseen run beside those of its `own` runs, and what speaks against it."""
    own, e = [one for one in own if np.isfinite(one.explained)], c.measured - c.predicted
    part = 1.0 - float(np.nanmean(e**2) / max(np.nanvar(c.measured), 1e-300))
    figure = Figure(c.run, f"{c.sensor}[{c.entry}]", float(np.sqrt(np.nanmean(e**2))), part, np.nan, unit)
    if not own:
        return figure, []
    here, there = _both_left(c, own)
    samples = [np.isfinite(one.measured).sum() for one in own]
    said = float(np.average([one.explained for one in own], weights=samples))
    square, white = (
        np.average([getattr(one, k) for one in there], weights=samples) for k in _Left._fields[:2]
    )
    noise = float(np.sqrt(square + max(0.0, here.white - white)))
    figure = figure._replace(on_own_runs=said, noise=noise)
    return figure, _against(figure, here, np.concatenate([one.g for one in there]))


def _against(figure: Figure, here: _Left, own: np.ndarray) -> list[str]:
    """What speaks against the model in one channel of a run, at most one sentence.  (3), (4)"""
    noise2, freedom, alpha = figure.noise**2, len(here.g) + len(own) - 2, 0.5 * CHANCE
    off = f"{figure.channel} of {figure.run} is off by {figure.error:.3g} {figure.unit}".rstrip()
    worse = (
        f"{off}, {figure.times:.1f} times what noise explains: of {figure.channel} the model explains "
        f"{100 * max(figure.explained, 0.0):.4g} % of {figure.run}, and {100 * figure.on_own_runs:.4g} % of "
        "its own runs"
    )
    if here.square > WORSE * noise2 and (freedom < 1 or not min(len(here.g), len(own))):
        return [f"{worse}; they are too short, or read too seldom, to tell that from chance: hold out more"]
    if here.square > WORSE * noise2:
        s = np.sqrt((len(here.g) * np.var(here.g) + len(own) * np.var(own)) / freedom)
        chance = students(1.0 - alpha, freedom) * s * np.sqrt(1.0 / len(here.g) + 1.0 / len(own))
        if here.g.mean() - own.mean() > chance:
            return [worse]
    if len(here.g) < 2 or len(own) < 2:
        return []
    k = int(np.argmax(here.g))
    chance = students(1.0 - alpha / len(here.g), len(own) - 1) * np.std(own, ddof=1)
    chance *= np.sqrt(1.0 + 1.0 / len(own))
    if here.g[k] > max(own.mean() + chance, own.max(), np.log(WORSE * noise2)):
        return [
            f"{figure.channel} of {figure.run} is off by {np.exp(0.5 * here.g[k]):.3g} {figure.unit}".rstrip()
            + f" from {here.t_s[k]:.0f} s to {here.t_s[k] + here.block_s:.0f} s, and nowhere else: what happened "
            "there, or was it driven as none of the fitted runs? Cut it with baqueano runs cut, or fit to such a run"
        ]
    return []


def _both_left(c: ChannelFit, own: Sequence[ChannelFit]) -> tuple[_Left, list[_Left]]:
    """What is left of a channel and of those of its `own` runs, in blocks of BLOCK_S if these are ENOUGH."""
    every = np.concatenate([one.measured - one.predicted for one in own])
    spread, tried = float(np.sqrt(np.nanmean(every**2))), []
    for block_s in (BLOCK_S, SHORT_S):
        here, *there = (_left(one, spread, block_s) for one in (c, *own))
        tried.append((min(len(here.g), sum(len(one.g) for one in there), ENOUGH), here, there))
    _, here, there = max(tried, key=lambda one: one[0])
    return here, there


def _left(c: ChannelFit, spread: float, block_s: float) -> _Left:
    """What is left of a channel in blocks of `block_s`, beyond CLIPPED times `spread` clipped."""
    e, known = c.measured - c.predicted, np.isfinite(c.measured - c.predicted)
    e, t = np.clip(e[known], -CLIPPED * spread, CLIPPED * spread), c.t_s[known]
    block = ((t - t[0]) // block_s).astype(int) if len(t) else np.zeros(0, int)
    numbers, counts = np.unique(block, return_counts=True)
    told = [b for b, n in zip(numbers, counts, strict=True) if n >= LEAST]
    g = [float(np.log(max(np.mean(e[block == b] ** 2), 1e-300))) for b in told]
    white = 0.5 * float(np.mean(np.diff(e) ** 2)) if len(e) > 1 else 0.0
    begins = [float(t[0] + b * block_s) for b in told]
    return _Left(float(np.mean(e**2)) if len(e) else 0.0, white, np.array(g), np.array(begins), block_s)
