"""The worlds in which the loop runs: a simulation, a recorded run, or the real vehicle, which needs neither."""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand
from baqueano.worlds.robot import Robot

if TYPE_CHECKING:
    from baqueano.worlds.replayed import ReplayedWorld
    from baqueano.worlds.simulated import SimulatedWorld, world_init, world_step

__all__ = ["ReplayedWorld", "Robot", "SimulatedWorld"]

__getattr__ = on_demand(
    __name__, {"replayed": ("ReplayedWorld",), "simulated": ("SimulatedWorld", "world_init", "world_step")}
)
