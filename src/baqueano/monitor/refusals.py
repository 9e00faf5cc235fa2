"""Count the rejected readings of each channel. The counts are one event at the end of a run, which is read again."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note

REFUSED_SOURCE = "refused"  # source of the event
OF_REFUSED, OF_ARRIVED = ".refused", ".arrived"  # endings of the names of the counts of a channel


class Refusals(NamedTuple):
    """The numbers of rejected readings and of all readings of a channel in a run.

    Attributes
    ----------
    name : str
        Name of the channel, such as "imu[2]".
    refused : int
        Number of rejected readings, to which the estimator gave a weight below 0.5.
    arrived : int
        Number of all readings.

    Examples
    --------
    >>> Refusals("imu[2]", 3, 2000).refused
    3
    """

    name: str
    refused: int
    arrived: int


def refusal_event(counts: Sequence[Refusals]) -> Diagnostic:
    """Return the message with the counts of all channels."""
    values: dict[str, Any] = {count.name + OF_REFUSED: count.refused for count in counts}
    values |= {count.name + OF_ARRIVED: count.arrived for count in counts}
    texts = [f"{count.name}: {count.refused}/{count.arrived}" for count in counts]
    return note("estimator.refused", each=texts, **values)


def refusals_of(events: Iterable[Tree]) -> tuple[Refusals, ...]:
    """Return the counts of rejected readings in the events of a run.

    Parameters
    ----------
    events : iterable of Event
        The events of a run.

    Returns
    -------
    tuple of Refusals
        An entry per channel; empty if the estimator does not report weights.

    Examples
    --------
    >>> refusals_of(bq.simulate(bq.load("small"), np.zeros((10, 3))).events)
    ()
    """
    refusals = [
        e.diagnostic.figures for e in events if e.source == REFUSED_SOURCE and e.diagnostic is not None
    ]
    entries = [
        (values, key.removesuffix(OF_REFUSED))
        for values in refusals
        for key in values
        if key.endswith(OF_REFUSED)
    ]
    return tuple(
        Refusals(name, values_of_event[name + OF_REFUSED], values_of_event[name + OF_ARRIVED])
        for values_of_event, name in entries
    )
