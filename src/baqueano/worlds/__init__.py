"""Where the loop runs: a simulation, a recorded run, or the real vehicle."""

from baqueano.worlds.replayed import Replayed
from baqueano.worlds.robot import Robot
from baqueano.worlds.simulated import Simulated, world_init, world_step

__all__ = ["Replayed", "Robot", "Simulated", "world_init", "world_step"]
