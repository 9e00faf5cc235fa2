"""Define the contracts of blocks and world, the optional attributes of blocks, and the types of values."""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand

if TYPE_CHECKING:
    from baqueano.contracts.blocks import Block, Supervision, World
    from baqueano.contracts.result import Result

__all__ = ["Block", "Result", "Supervision", "World"]

__getattr__ = on_demand(__name__, {"blocks": ("Block", "Supervision", "World"), "result": ("Result",)})
