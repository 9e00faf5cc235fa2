"""Define the worlds in which the loop runs: a simulation, with or without faults, a recorded run, or a robot."""

from typing import TYPE_CHECKING

from baqueano.contracts.blocks import World
from baqueano.on_demand import on_demand
from baqueano.worlds.robot import Robot

if TYPE_CHECKING:
    from baqueano.worlds.faults import Fault, Ledger, fault_ledger
    from baqueano.worlds.faulty_world import FaultyWorld
    from baqueano.worlds.replayed import ReplayedWorld
    from baqueano.worlds.simulated import SimulatedWorld, world_init, world_step

__all__ = [
    "Fault",
    "FaultyWorld",
    "Ledger",
    "ReplayedWorld",
    "Robot",
    "SimulatedWorld",
    "World",
    "fault_ledger",
]

__getattr__ = on_demand(
    __name__,
    {
        "faults": ("Fault", "Ledger", "fault_ledger"),
        "replayed": ("ReplayedWorld",),
        "faulty_world": ("FaultyWorld",),
        "simulated": ("SimulatedWorld", "world_init", "world_step"),
    },
)
