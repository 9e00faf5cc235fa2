"""Where the loop runs: a simulation or a recorded run."""

from baqueano.worlds.replayed import Replayed
from baqueano.worlds.simulated import Simulated, world_init, world_step

__all__ = ["Replayed", "Simulated", "world_init", "world_step"]
