"""Split a long run into short segments, each with its own initial state: multiple shooting.

    A_r = A − A_s A_ss⁻¹ A_sᵀ,   B_r = G B Gᵀ,   G = (I, −A_s A_ss⁻¹)                                       (1)
    d⊥ = d − d_s A_ss⁻¹ A_sᵀ,   A_r = Σ w d⊥ d⊥ᵀ                                                           (2)

A simulation without correction drifts away, because of its heading error and of process noise. Each segment of a few
seconds has its own initial state (its start), and all segments share the parameters: θ = (shared | by run | by
segment). Before its first measurement a segment has a lead, in which delayed commands and sensors fill their buffers.
The starts s are nuisance parameters. They are eliminated block by block (1), or row by row with the weights w = ψ'(r)
of A (2). Source: Bock 1983 for the segments; Schur's complement.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baqueano.identify.data.record import FitRecord, Measurements

# of the largest eigenvalue of a start's information: directions below it are unobservable
MIN_RELATIVE_EIGENVALUE = 1e-9


class ThetaLayout(NamedTuple):
    """Indices in θ of the entries of each segment."""

    shared_count: int
    run_entry_count: int
    start_size: int
    runs: tuple[int, ...]  # of each segment

    @property
    def first_start(self) -> int:
        """Return the index of the first start."""
        return self.shared_count + self.run_entry_count * (max(self.runs) + 1)

    @property
    def size(self) -> int:
        """Return the length of θ."""
        return self.first_start + self.start_size * len(self.runs)

    @property
    def indices(self) -> list[np.ndarray]:
        """Return for each segment the indices of its entries in θ."""
        s, o, q = self.shared_count, self.run_entry_count, self.start_size
        first = self.first_start
        return [
            np.concatenate(
                [
                    np.arange(s),
                    np.arange(s + run * o, s + (run + 1) * o),
                    np.arange(first + k * q, first + (k + 1) * q),
                ]
            )
            for k, run in enumerate(self.runs)
        ]

    def start_slice(self, k: int) -> slice:
        """Return the slice of θ with the start of segment k."""
        return slice(self.first_start + k * self.start_size, self.first_start + (k + 1) * self.start_size)


def split_record(record: FitRecord, segment_s: float, lead_s: float) -> list[FitRecord]:
    """Return segments of about `segment_s` [s]. Each segment after the first has a lead of `lead_s` [s].

    The lead does not contain measurements. It is at least one row long, because a reading between ticks is
    interpolated between rows.
    """
    ends = np.cumsum(record.dt_s)
    count = max(1, round(float(ends[-1]) / segment_s))
    edges = np.searchsorted(ends, ends[-1] * np.arange(1, count) / count)
    edges = np.unique(np.concatenate([[0], edges, [len(ends)]]))
    segments = []
    for first, last in pairwise(edges):
        begin = int(np.searchsorted(ends, ends[first] - lead_s))
        segments.append(_segment(record, max(min(begin, int(first) - 1), 0), int(first), int(last)))
    return segments


def _segment(record: FitRecord, begin: int, first: int, last: int) -> FitRecord:
    sensors = {}
    for name, (z, has, sample_fraction) in record.sensors.items():
        has = has[begin:last].copy()
        has[: first - begin] = 0.0
        sensors[name] = Measurements(
            z[begin:last], has, None if sample_fraction is None else sample_fraction[begin:last]
        )
    t_s, dt_s, u = (a[begin:last] for a in (record.t_s, record.dt_s, record.u))
    return record._replace(t_s=t_s, dt_s=dt_s, u=u, sensors=sensors, lead=first - begin)


def eliminate_starts(
    bread: np.ndarray, meat: np.ndarray, layout: ThetaLayout
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B (r, r) of the shared entries and of the entries by run, with the starts eliminated.  (1)"""
    return eliminate(
        bread, meat, layout.first_start, [layout.start_slice(k) for k in range(len(layout.runs))]
    )


def eliminate(
    bread: np.ndarray, meat: np.ndarray, first: int, blocks: Sequence[slice]
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B (r, r) of the first r = `first` entries, with the `blocks` eliminated.

    The information between two different blocks must be 0.  (1)
    """
    A, B = bread[:first, :first].copy(), meat[:first, :first].copy()
    for entries in blocks:
        gain = bread[:first, entries] @ _inverse(bread[entries, entries])  # A_s A_ss⁻¹
        A -= gain @ bread[entries, :first]
        cross = gain @ meat[entries, :first]
        B += gain @ meat[entries, entries] @ gain.T - cross - cross.T
    return 0.5 * (A + A.T), 0.5 * (B + B.T)


def derivatives_without_start(d: np.ndarray, w: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return d⊥ (N, m, q) from the derivatives d (N, m, p) of a segment with weights w (N, m).

    `start` (p,) is a mask of the entries of its start.  (2)
    """
    start_derivatives, other_derivatives = d[..., start], d[..., ~start]
    weighted_derivatives = start_derivatives * w[..., None]
    axes = (0, 1), (0, 1)
    projection = _inverse(np.tensordot(weighted_derivatives, start_derivatives, axes)) @ np.tensordot(
        weighted_derivatives, other_derivatives, axes
    )
    return other_derivatives - start_derivatives @ projection


def _inverse(A: np.ndarray) -> np.ndarray:
    """Return the pseudo-inverse of a small information matrix; it is 0 in directions without information."""
    root = np.sqrt(np.maximum(np.diagonal(A), 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(root, root))
    positive = values > MIN_RELATIVE_EIGENVALUE * np.max(values, initial=1e-300)
    columns = vectors[:, positive]
    return (columns / values[positive]) @ columns.T / np.outer(root, root)
