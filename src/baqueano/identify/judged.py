"""A fit on runs that it has not seen: simulated from the commands alone, parameters as they are.

    e = z − h(θ̂),   error = √ mean e²,   explained = 1 − Σ e² / Σ (z − z̄)²                                 (1)
    noise² = mean e_own² + max(0, w² − w_own²),   w² = ½ mean (e_{k+1} − e_k)²                            (2)
    g_b = log mean_{block b} e²,   (ḡ − ḡ_own) / s √(1/B + 1/B_own) > t_{0.99}   and   error² > 2 noise²   (3)

What belongs to a run and not to the vehicle is found on the run itself, for nobody knows it before: the IMU's biases,
the velocity at the start, clocks and other numbers that the fit found run by run. Everything else is the fit's.

A share of the variance alone judges badly: where the own runs are explained to 99 %, 90 % are an error of three times
the size, and a run that hardly moved is explained by no model. So the error is held against what noise explains (2):
what the fit leaves of its own runs, sensor and floor together, and the white part by which this run is louder (w, von
Neumann's: vibration grows with speed, and no model takes it away). The model is said not to carry over where its own
part of e² is larger than that of the noise, and where that is no chance (3): blocks of BLOCK_S are as good as
independent (choose/held_out.py), s is the scatter of g over the blocks of both. A single block whose g lies beyond what
the highest of B blocks reaches by chance is told with its time: something happened there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.errors import UsageError
from baqueano.identify.answer.channel_units import channel_unit
from baqueano.identify.answer.result import ChannelFit, Fit, asked_for
from baqueano.identify.batches import students
from baqueano.identify.choose.held_out import BLOCK_S
from baqueano.identify.fit import identify
from baqueano.identify.rows.tape import KINDS
from baqueano.runs.run import Run

WORSE = 2.0  # of error² to noise²: above it more than half of the error is the model's
CHANCE = 0.01  # of a warning for a model that carries over
CLIPPED = 10.0  # noises beyond which an error counts no more: one spike is not the model's
LEAST = 10  # readings of a block that is counted


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
    all_own = np.concatenate([one.measured - one.predicted for one in own] or [np.array([np.nan])])
    spread = float(np.sqrt(np.nanmean(all_own**2))) if np.isfinite(all_own).any() else float("nan")
    here, there = _left(c, spread), [_left(one, spread) for one in own if np.isfinite(one.explained)]
    e = c.measured - c.predicted
    part = 1.0 - float(np.nanmean(e**2) / max(np.nanvar(c.measured), 1e-300))
    said = own[0].explained if len(own) == 1 else float(np.mean([one.explained for one in own] or [np.nan]))
    noise = float("nan")
    if there:
        samples = [np.isfinite(one.measured).sum() for one in own if np.isfinite(one.explained)]
        square, white = (
            np.average([getattr(one, k) for one in there], weights=samples) for k in _Left._fields[:2]
        )
        noise = float(np.sqrt(square + max(0.0, here.white - white)))
    label = f"{c.sensor}[{c.entry}]"
    figure = Figure(c.run, label, float(np.sqrt(np.nanmean(e**2))), part, said, unit, noise)
    return figure, [] if not there else _against(figure, here, np.concatenate([one.g for one in there]))


def _against(figure: Figure, here: _Left, own: np.ndarray) -> list[str]:
    """What speaks against the model in one channel of a run, at most one sentence.  (3)"""
    noise2, count = figure.noise**2, len(here.g) + len(own)
    both = [here.g - here.g.mean(), own - own.mean()] if min(len(here.g), len(own)) else []
    s = float(np.sqrt(sum(float(x @ x) for x in both) / max(count - 2, 1))) if count > 2 and both else 0.0
    off = f"{figure.channel} of {figure.run} is off by {figure.error:.3g} {figure.unit}".rstrip()
    if here.square > WORSE * noise2:
        chance = students(1.0 - CHANCE, max(5, count - 2)) * s
        apart = float(here.g.mean() - own.mean()) if both else np.inf
        if apart > chance * np.sqrt(1.0 / max(len(here.g), 1) + 1.0 / max(len(own), 1)):
            return [
                f"{off}, {figure.times:.1f} times what noise explains: of {figure.channel} the model explains "
                f"{100 * max(figure.explained, 0.0):.4g} % of {figure.run}, and {100 * figure.on_own_runs:.4g} % of "
                "its own runs"
            ]
    if len(here.g) < 2 or len(own) < 2:
        return []
    k, most = int(np.argmax(here.g)), students(1.0 - CHANCE / len(here.g), max(5, len(own) - 1))
    if here.g[k] > max(own.mean() + most * np.std(own, ddof=1), own.max(), np.log(WORSE * noise2)):
        return [
            f"{figure.channel} of {figure.run} is off by {np.exp(0.5 * here.g[k]):.3g} {figure.unit}".rstrip()
            + f" from {here.t_s[k]:.0f} s to {here.t_s[k] + BLOCK_S:.0f} s, and nowhere else: what happened there, or "
            "was it driven as none of the fitted runs? Cut it with baqueano runs cut, or fit to such a run"
        ]
    return []


def _left(c: ChannelFit, spread: float) -> _Left:
    """What is left of a channel, beyond CLIPPED times `spread` clipped."""
    e, known = c.measured - c.predicted, np.isfinite(c.measured - c.predicted)
    e, t = np.clip(e[known], -CLIPPED * spread, CLIPPED * spread), c.t_s[known]
    block = ((t - t[0]) // BLOCK_S).astype(int) if len(t) else np.zeros(0, int)
    numbers, counts = np.unique(block, return_counts=True)
    told = [b for b, n in zip(numbers, counts, strict=True) if n >= LEAST]
    g = [float(np.log(max(np.mean(e[block == b] ** 2), 1e-300))) for b in told]
    white = 0.5 * float(np.mean(np.diff(e) ** 2)) if len(e) > 1 else 0.0
    begins = [float(t[0] + b * BLOCK_S) for b in told]
    return _Left(float(np.mean(e**2)) if len(e) else 0.0, white, np.array(g), np.array(begins))
