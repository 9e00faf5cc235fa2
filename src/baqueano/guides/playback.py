"""The references of a recorded run, once more."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.signals import Estimate, Reference


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """Give the references of a run again, bit for bit."""

    as_written: ClassVar[bool] = True

    t_ns: np.ndarray  # (N,) int64
    eta: np.ndarray  # (N, 3)
    nu: np.ndarray  # (N, 3)
    done: np.ndarray  # (N,)

    def init(self) -> None:
        """Return no state."""

    def step(self, state: None, estimate: Estimate) -> tuple[None, Reference]:
        """Return the reference of this time."""
        k = max(int(np.searchsorted(self.t_ns, estimate.t_ns, side="right")) - 1, 0)
        return None, Reference(estimate.t_ns, self.eta[k], self.nu[k], float(self.done[k]))
