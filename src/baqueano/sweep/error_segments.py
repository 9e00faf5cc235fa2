"""Summarize a series of errors by sums of squares over time segments, and by its correlation time.

    rms = √(Σ_b S_b / Σ_b n_b),   S_b = Σ e², n_b samples of the segment b                                 (1)
    T = δ (1 + 2 Σ_{k ≤ w} ρ_k),   ρ: autocorrelation of e²,  w: the first k with k δ ≥ c T               (2)

A sample for a span of time, such as a relative error, belongs to a segment only if its whole span is inside. Samples
over the time T contain as much information as one independent sample. T is corrected for the bias from the mean of a
short series. Source: Sokal, Monte Carlo Methods in Statistical Mechanics, 1989, section 3.
"""

from typing import NamedTuple

import numpy as np

from baqueano.signals import NANOSECONDS, seconds

SEGMENT_S = 10.0
MIN_SPANS = 4.0  # least length of a segment, in spans of a relative error
# least length of the last segment, in lengths; a shorter remainder is added to the previous segment
MIN_LAST_LENGTH = 0.9
WINDOW_TIMES = 5.0


class ErrorSegments(NamedTuple):
    """Sums over the B segments of a drive.  (1)

    Attributes
    ----------
    squares, samples : tuple of float (B,)
        S_b and n_b.
    length_s : float
        Length of a segment.
    correlation_s : float
        T, the correlation time of the squares.  (2)
    """

    squares: tuple[float, ...]
    samples: tuple[float, ...]
    length_s: float = SEGMENT_S
    correlation_s: float = 0.0


def error_segments(t_ns: np.ndarray, e: np.ndarray, span_s: float = 0.0) -> ErrorSegments:
    """Return the segments of a series of errors (N,); each error covers the span `span_s` after its time."""
    length_s = max(SEGMENT_S, MIN_SPANS * span_s)
    if not len(t_ns):
        return ErrorSegments((), (), length_s)
    t_s = seconds(t_ns, t_ns[0])
    count = max(1, int((t_s[-1] + span_s) / length_s + 1.0 - MIN_LAST_LENGTH))
    end_s = t_s + max(span_s - 1e-9, 0.0)
    first_piece, last_piece = (np.minimum(t // length_s, count - 1).astype(int) for t in (t_s, end_s))
    is_inside = np.isfinite(e) & (first_piece == last_piece)
    squares, samples = (
        np.bincount(first_piece[is_inside], x[is_inside], count) for x in (e * e, np.ones(len(e)))
    )
    finite = np.isfinite(e)
    return ErrorSegments(
        tuple(squares.tolist()),
        tuple(samples.tolist()),
        length_s,
        correlation_time(t_ns[finite], e[finite] ** 2),
    )


def correlation_time(t_ns: np.ndarray, x: np.ndarray) -> float:
    """Return the correlation time T [s] of a series (N,); 0 if the series is constant.  (2)"""
    n = len(x)
    if n < 3 or not np.ptp(x) > 0.0:
        return 0.0
    power = np.abs(np.fft.rfft(x - np.mean(x), 2 * n)) ** 2
    rho = np.fft.irfft(power)[:n]
    sums, k = 2.0 * np.cumsum(rho / rho[0]) - 1.0, np.arange(n)
    w = int(np.argmax(k >= WINDOW_TIMES * sums))
    bias_factor = 1.0 + (2.0 * w + 1.0) / n
    return float(np.max(sums[: w + 1]) * bias_factor * np.median(np.diff(t_ns)) / NANOSECONDS)
