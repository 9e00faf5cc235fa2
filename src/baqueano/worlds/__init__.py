"""The worlds in which the loop runs: a simulation, a recorded run, or the real vehicle, which needs neither."""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand
from baqueano.worlds.robot import Robot

if TYPE_CHECKING:
    from baqueano.worlds.replayed import Replayed
    from baqueano.worlds.simulated import Simulated, world_init, world_step

__all__ = ["Replayed", "Robot", "Simulated"]

__getattr__ = on_demand(
    __name__, {"replayed": ("Replayed",), "simulated": ("Simulated", "world_init", "world_step")}
)
