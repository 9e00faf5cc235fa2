"""Count the rejected readings of each channel. The last event of a run contains the counts, and is read again."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note

REJECTIONS_SOURCE = "refused"  # source of the event
REFUSED_SUFFIX, ARRIVED_SUFFIX = ".refused", ".arrived"  # endings of the names of the counts of a channel


class Rejections(NamedTuple):
    """The numbers of rejected readings and of all readings of a channel in a run.

    Attributes
    ----------
    name : str
        Name of the channel, such as "imu[2]".
    rejected_count : int
        Number of rejected readings, to which the estimator gave a weight below 0.5.
    reading_count : int
        Number of all readings that could correct the pose or the velocity.

    Examples
    --------
    >>> Rejections("imu[2]", 3, 2000).rejected_count
    3
    """

    name: str
    rejected_count: int
    reading_count: int


def rejection_event(counts: Sequence[Rejections]) -> Diagnostic:
    """Return the message with the counts of the channels that correct the estimate."""
    values: dict[str, Any] = {count.name + REFUSED_SUFFIX: count.rejected_count for count in counts}
    values |= {count.name + ARRIVED_SUFFIX: count.reading_count for count in counts}
    active_counts = [count for count in counts if count.reading_count] or counts
    texts = [f"{count.name}: {count.rejected_count}/{count.reading_count}" for count in active_counts]
    return note("estimator.refused", reasons=texts, **values)


def rejections_in(events: Iterable[Tree]) -> tuple[Rejections, ...]:
    """Return the counts of rejected readings in the events of a run.

    Parameters
    ----------
    events : iterable of Event
        The events of a run.

    Returns
    -------
    tuple of Rejections
        An entry per channel; empty if the estimator does not report weights.

    Examples
    --------
    >>> rejections_in(bq.simulate(bq.load("small"), np.zeros((10, 3))).events)
    ()
    """
    refusals = [
        e.diagnostic.figures for e in events if e.source == REJECTIONS_SOURCE and e.diagnostic is not None
    ]
    entries = [
        (values, key.removesuffix(REFUSED_SUFFIX))
        for values in refusals
        for key in values
        if key.endswith(REFUSED_SUFFIX)
    ]
    return tuple(
        Rejections(name, values_of_event[name + REFUSED_SUFFIX], values_of_event[name + ARRIVED_SUFFIX])
        for values_of_event, name in entries
    )
