"""The references of a recorded run, once more."""

from dataclasses import dataclass

import numpy as np

from baqueano.signals import Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """A guide that says again, bit for bit, what a guide said in a run."""

    t_ns: np.ndarray  # (N,) int64
    eta: np.ndarray  # (N, 3)
    nu: np.ndarray  # (N, 3)
    done: np.ndarray  # (N,)

    def init(self) -> None:
        """Nothing to remember."""

    def step(self, state: None, estimate: Estimate) -> tuple[None, Reference]:
        """What was said at this time."""
        k = max(int(np.searchsorted(self.t_ns, estimate.t_ns, side="right")) - 1, 0)
        return None, Reference(estimate.t_ns, self.eta[k], self.nu[k], float(self.done[k]))
