"""The blocks of a vehicle file that a fit is about."""

from typing import NamedTuple

from baqueano.contracts.values import Tree
from baqueano.signals import ByName


class FittedBlocks(NamedTuple):
    """The part of a vehicle that a fit sees, by the tables of its file."""

    model: Tree
    sensors: ByName[Tree]  # NamedTuple of sensor blocks
