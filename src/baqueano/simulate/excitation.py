"""Generate persistently exciting command signals: pure functions of a seed.

    random_steps   u(t) = a random level in [−limit, limit], held for hold_s                              (1)
    multisine      u(t) = A Σ_k cos(2π f_k t + φ_k), φ_k random, scaled so that max |u| = limit            (2)
    prbs           u(t) = ± limit, switching by chance every bit_s                                        (3)
    ramps          u(t) = triangle of growing height: from rest to the limit and back                     (4)

All return (N, n), one row per tick, with |u| ≤ limit in each channel; a channel with limit 0 stays 0. Random steps
show friction and forces at the same time; the paper's case study uses them. A multisine spreads its power evenly and
suits the frequency domain. A PRBS is best for lags. Ramps show dry friction and dead zones. These signals do not
depend on the vehicle or the room. design/plan.py designs a signal for both, and design/containment.py keeps any signal
inside a room. The channels of a signal are independent, so that the columns of T can be separated. Source: Ljung,
System Identification, 1999, 13.3.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from baqueano.contracts.calls import checked_call
from baqueano.diagnostics import nearest
from baqueano.errors import UsageError


def random_steps(
    limit: ArrayLike, duration_s: float, rate_hz: float, seed: int = 0, *, hold_s: float = 1.0
) -> np.ndarray:
    """Return uniform random levels, each held for `hold_s`.

    Parameters
    ----------
    limit : array_like (n,) [unit of the command]
        Largest command of each channel; 0 for a channel that stays still.
    duration_s : float
        Length of the signal.
    rate_hz : float
        Ticks per second.
    seed : int
        The same seed gives the same signal.
    hold_s : float
        Length of a level.

    Returns
    -------
    ndarray (N, n)
        Commands, one row per tick [unit of u].

    Notes
    -----
    Equation (1) of the module.

    Examples
    --------
    >>> random_steps([0.5], 3.0, 2.0, hold_s=1.0).shape
    (6, 1)
    """
    limit, n_ticks = _validate(limit, duration_s, rate_hz)
    hold_ticks = _ticks(hold_s, rate_hz, "hold_s")
    levels = np.random.default_rng(seed).uniform(-1.0, 1.0, (-(-n_ticks // hold_ticks), len(limit)))
    return np.repeat(levels, hold_ticks, axis=0)[:n_ticks] * limit


def _multisine(
    limit: ArrayLike,
    duration_s: float,
    rate_hz: float,
    seed: int = 0,
    *,
    low_hz: float = 0.05,
    high_hz: float = 5.0,
) -> np.ndarray:
    """Return sums of sines between `low_hz` and `high_hz`. No two channels share a frequency.  (2)"""
    limit, n_ticks = _validate(limit, duration_s, rate_hz)
    if not 0.0 < low_hz < high_hz < 0.5 * rate_hz:
        raise UsageError.of("signal.band", low_hz=low_hz, high_hz=high_hz, max_hz=0.5 * rate_hz)
    moving_axes = np.flatnonzero(limit > 0.0)
    t_s = np.arange(n_ticks) / rate_hz
    bins = np.arange(np.ceil(low_hz * duration_s), np.floor(high_hz * duration_s) + 1)
    if len(bins) < 2 * max(1, len(moving_axes)):
        raise UsageError.of(
            "signal.few-sines",
            duration_s=duration_s,
            sines=len(bins),
            low_hz=low_hz,
            high_hz=high_hz,
            minimum=2 * len(moving_axes),
        )
    rng = np.random.default_rng(seed)
    u = np.zeros((n_ticks, len(limit)))
    for order, j in enumerate(moving_axes):
        f_hz = bins[order :: len(moving_axes)] / duration_s
        phase = rng.uniform(0.0, 2.0 * np.pi, len(f_hz))
        wave = np.zeros(n_ticks)
        for f, phi in zip(f_hz, phase, strict=True):
            wave += np.cos(2.0 * np.pi * f * t_s + phi)
        u[:, j] = limit[j] * wave / np.max(np.abs(wave))
    return u


def _prbs(
    limit: ArrayLike, duration_s: float, rate_hz: float, seed: int = 0, *, bit_s: float = 0.2
) -> np.ndarray:
    """Return full commands, forward or backward at random for each bit.  (3)"""
    limit, n_ticks = _validate(limit, duration_s, rate_hz)
    bit_ticks = _ticks(bit_s, rate_hz, "bit_s")
    signs = np.random.default_rng(seed).integers(0, 2, (-(-n_ticks // bit_ticks), len(limit))) * 2.0 - 1.0
    return np.repeat(signs, bit_ticks, axis=0)[:n_ticks] * limit


def _ramps(
    limit: ArrayLike, duration_s: float, rate_hz: float, seed: int = 0, *, ramp_s: float = 4.0
) -> np.ndarray:
    """Return triangles up and down, each of random height and sign. The channels are shifted in time.  (4)"""
    limit, n_ticks = _validate(limit, duration_s, rate_hz)
    ramp_ticks = _ticks(ramp_s, rate_hz, "ramp_s")
    rng = np.random.default_rng(seed)
    triangle = 1.0 - np.abs(2.0 * (np.arange(ramp_ticks) + 0.5) / ramp_ticks - 1.0)
    u = np.zeros((n_ticks, len(limit)))
    for j in range(len(limit)):
        shift = (j * ramp_ticks) // max(1, len(limit))
        count = -(-(n_ticks + shift) // ramp_ticks)
        heights = rng.uniform(0.3, 1.0, count) * rng.choice([-1.0, 1.0], count)
        u[:, j] = limit[j] * (heights[:, None] * triangle).ravel()[shift : shift + n_ticks]
    return u


KINDS: dict[str, Callable[..., np.ndarray]] = {
    "random_steps": random_steps,
    "multisine": _multisine,
    "prbs": _prbs,
    "ramps": _ramps,
}


@checked_call('bq.excitation("random_steps", robot.command.limit, 60.0, robot.rate_hz)')
def excitation(
    kind: str,
    limit: ArrayLike,
    duration_s: float,
    rate_hz: float,
    seed: int = 0,
    *,
    rest_s: float = 0.0,
    **options: Any,
) -> np.ndarray:
    """Return the signal named `kind`. The rests at its beginning and end show the sensors' noise and biases.

    Parameters
    ----------
    kind : str
        "random_steps", "multisine", "prbs" or "ramps".
    limit : array_like (n,) [unit of the command]
        Largest command of each channel; 0 for a channel that stays still.
    duration_s : float
        Length of the signal with its rests.
    rate_hz : float
        Ticks per second.
    seed : int
        The same seed gives the same signal.
    rest_s : float
        Length of each rest.
    **options : float
        Length of a level, bit or triangle [s]: `hold_s`, `bit_s`, `ramp_s`; band of a multisine [Hz]: `low_hz`,
        `high_hz`.

    Returns
    -------
    ndarray (N, n)
        Commands, one row per tick [unit of u].

    Raises
    ------
    UsageError
        For an unknown name, a rest that leaves no time to move, a limit that is negative or not finite. For a band
        that the rate cannot show, and for a time too short for two sines per channel.

    Examples
    --------
    >>> u = excitation("prbs", [1.0, 0.0, 1.0], 10.0, 100.0, rest_s=1.0, bit_s=0.5)
    >>> u.shape, u.max(axis=0).tolist()
    ((1000, 3), [1.0, 0.0, 1.0])
    """
    if kind not in KINDS:
        raise UsageError.of("signal.unknown", value=kind, suggestion=nearest(kind, [*KINDS, "designed"]))
    moving_s = duration_s - 2.0 * rest_s
    if not (rest_s >= 0.0 and moving_s > 0.0):
        raise UsageError.of("signal.all-rest", rest_s=rest_s, moving_s=moving_s, duration_s=duration_s)
    u = KINDS[kind](limit, moving_s, rate_hz, seed, **options)
    rest = np.zeros((round(rest_s * rate_hz), u.shape[1]))
    return np.concatenate([rest, u, rest]) + 0.0  # not -0.0


def _validate(limit: ArrayLike, duration_s: float, rate_hz: float) -> tuple[np.ndarray, int]:
    """Return the limits (n,) and the number of ticks. Raise UsageError if a limit, the duration or the rate is
    invalid."""
    limit = np.atleast_1d(np.array(limit, dtype=float))
    if limit.ndim != 1 or not np.all(np.isfinite(limit)) or np.any(limit < 0.0):
        raise UsageError.of("signal.limit", limit=limit.tolist())
    if not (rate_hz > 0.0 and duration_s * rate_hz >= 1.0 and np.isfinite(duration_s * rate_hz)):
        raise UsageError.of("signal.no-tick", duration_s=duration_s, rate_hz=rate_hz)
    return limit, round(duration_s * rate_hz)


def _ticks(span_s: float, rate_hz: float, name: str) -> int:
    ticks = round(span_s * rate_hz) if np.isfinite(span_s) else 0
    if ticks < 1:
        raise UsageError.of("signal.short", name=name, span_s=span_s, min_s=1.0 / rate_hz)
    return ticks
