"""One thing that was found in the data of a fit or in what it left over."""

from typing import NamedTuple

NOTE, WARN, REFUSED = "note", "WARN", "REFUSED"


class Finding(NamedTuple):
    """A sentence for the verdict.

    `level`: "note" was mended or is good to know, "WARN" makes the fit a warning, "REFUSED" refuses it.
    """

    code: str  # one word or two, the same for the same kind of thing
    level: str
    text: str  # what was found, with its figure, and what to do
    widens: tuple[tuple[str, float], ...] = ()  # parameters, by path, and how far each may be off by it
