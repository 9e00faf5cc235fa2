"""Readings that an estimator refused, counted by number: one event at the end of a run, and its reader."""

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from baqueano.contracts.values import Tree

REFUSED = "refused"  # source of the event
_ONE = re.compile(r"(\S+): (\d+) of (\d+)")


class Refusals(NamedTuple):
    """Of one number in a run."""

    name: str  # "imu[2]"
    refused: int
    arrived: int


def written(counts: Sequence[Refusals]) -> str:
    """Return the text of the event."""
    return ", ".join(f"{one.name}: {one.refused} of {one.arrived}" for one in counts)


def refusals_of(events: Iterable[Tree]) -> tuple[Refusals, ...]:
    """Return the counts in the events of a run; none of an estimator that does not count."""
    found = [one for e in events if e.source == REFUSED for one in _ONE.findall(e.text)]
    return tuple(Refusals(name, int(refused), int(arrived)) for name, refused, arrived in found)
