"""Define the worlds in which the loop runs: a simulation, with or without faults, a recorded run, or a robot."""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand
from baqueano.worlds.robot import Robot

if TYPE_CHECKING:
    from baqueano.worlds.faults import Fault, Ledger, ledger_of
    from baqueano.worlds.replayed import ReplayedWorld
    from baqueano.worlds.shaken import ShakenWorld
    from baqueano.worlds.simulated import SimulatedWorld, world_init, world_step

__all__ = ["Fault", "Ledger", "ReplayedWorld", "Robot", "ShakenWorld", "SimulatedWorld", "ledger_of"]

__getattr__ = on_demand(
    __name__,
    {
        "faults": ("Fault", "Ledger", "ledger_of"),
        "replayed": ("ReplayedWorld",),
        "shaken": ("ShakenWorld",),
        "simulated": ("SimulatedWorld", "world_init", "world_step"),
    },
)
