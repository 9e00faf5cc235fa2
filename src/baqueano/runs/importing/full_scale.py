"""Find the readings of an IMU at full scale in the columns of a recording.

A converter of 16 bits ends at ±32767 and −32768. A column of whole numbers up to there has these ends. Other whole
numbers can end at 2^k, and other columns at a full scale of chips in use (samples.py). A reading at full scale only
bounds its quantity, so it becomes a gap of its channel. The other channels keep their readings.
"""

from collections.abc import Iterator

import numpy as np

from baqueano.diagnostics import note
from baqueano.parameter import INF
from baqueano.runs.diagnostics.finding import ImportFinding
from baqueano.runs.diagnostics.samples import (
    FULL_SCALES,
    MIN_SAMPLES,
    EndSamples,
    channel_resolution,
    end_samples,
)
from baqueano.runs.importing.sources import Source
from baqueano.runs.maps.columns import KINDS, ColumnSignal, Entry

LARGEST_WORD = 32767.0
LARGEST_NUMBER = 1e100  # a larger one is a damaged cell, and differences of such cells overflow
WORD_SCALES = 2.0 ** np.arange(9, 17)


def without_full_scale(
    signal: ColumnSignal, source: Source, values: np.ndarray, findings: list[ImportFinding]
) -> np.ndarray:
    """Return `values` (rows, entries) with NaN at full scale; only an IMU is tested. Findings report the gaps."""
    for k, at_end in _entry_ends(signal, source):
        entry, first_ns = signal.entries[k], int(source.t_ns[np.argmax(at_end.mask)])
        figures = {"rows": len(values), "share": at_end.lost / len(values), "full_scale_count": at_end.at_end}
        ends = [int(end) if end == int(end) else end for end in at_end.ends]
        reason = note("recording.full-scale", key=entry.key, excluded_rows=at_end.lost, ends=ends, **figures)
        findings.append(
            ImportFinding("full scale", "warning", reason, note("recording.larger-range"), t_ns=first_ns)
        )
        values[at_end.mask, k] = np.nan
    return values


def _entry_ends(signal: ColumnSignal, source: Source) -> Iterator[tuple[int, EndSamples]]:
    """Yield each entry that has readings at full scale."""
    for k, (entry, measures) in enumerate(zip(signal.entries, KINDS["imu"], strict=False)):
        if signal.kind == "imu" and entry.column is not None and not entry.derivative:
            at_end = _column_ends(source.table.numbers(entry.column), entry, measures)
            if at_end.lost:
                yield k, at_end


def _column_ends(words: np.ndarray, entry: Entry, measures: str) -> EndSamples:
    """Return the samples at full scale of a column, in its own numbers."""
    finite_words = words[np.isfinite(words)]
    if len(finite_words) < MIN_SAMPLES or np.max(np.abs(finite_words)) > LARGEST_NUMBER:
        return EndSamples(np.zeros(len(words), bool), [], 0)
    is_integer = (
        bool(np.all(finite_words == np.round(finite_words))) and float(np.ptp(finite_words)) > WORD_SCALES[0]
    )
    is_16_bit = is_integer and float(np.max(np.abs(finite_words))) <= LARGEST_WORD + 1.0
    factor = abs(entry.scale * entry.si_factor)
    scales = WORD_SCALES if is_integer else FULL_SCALES[measures] / max(factor, 1e-300)
    return end_samples(words, channel_resolution(finite_words), LARGEST_WORD if is_16_bit else INF, scales)
