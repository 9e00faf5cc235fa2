"""The blocks of a vehicle file that a fit is about."""

from typing import Any, NamedTuple


class Blocks(NamedTuple):
    """The part of a vehicle that a fit sees, by the tables of its file."""

    model: Any
    sensors: Any  # NamedTuple of sensor blocks
