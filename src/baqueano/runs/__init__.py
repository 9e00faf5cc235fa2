"""A run on disk: write, read, recover, cut, list, import, export."""

from baqueano.runs.reader import read_run
from baqueano.runs.run import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog
from baqueano.runs.writer import RunWriter, write_run

__all__ = [
    "Channel",
    "EstimateLog",
    "Event",
    "ReferenceLog",
    "Run",
    "RunWriter",
    "TruthLog",
    "read_run",
    "write_run",
]
