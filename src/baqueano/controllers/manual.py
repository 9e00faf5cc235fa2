"""Manual drive: a person gives the commands."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.errors import ExternalError
from baqueano.signals import Command, Estimate, Reference


class DriveEnded(ExternalError, KeyboardInterrupt):
    """Exception that ends a manual drive because the driver requested its end."""


@dataclass(frozen=True, slots=True, eq=False)
class ManualController:
    """Controller that requests each command from a person.

    It is the only block that is not pure, so a replay of its run uses the recorded commands.

    Parameters
    ----------
    command : callable
        Returns the command (n,) that the person requests now; KeyboardInterrupt ends the drive.

    Examples
    --------
    >>> from baqueano.signals import Estimate
    >>> hand = ManualController(lambda: [0.3, 0.0, 0.1])
    >>> hand.step(None, None, Estimate(0, np.zeros(3), np.zeros(3), np.eye(6)))[1].u
    array([0.3, 0. , 0.1])
    """

    is_interpreted: ClassVar[bool] = True

    command: Callable[[], object]

    def init(self) -> None:
        """Return None: this controller does not have a state."""

    def step(self, state: None, reference: Reference, estimate: Estimate) -> tuple[None, Command]:
        """Return the command (n,) that the person requests; raise `DriveEnded` if the person ends the drive."""
        try:
            return None, Command(estimate.t_ns, np.array(self.command(), dtype=float))
        except KeyboardInterrupt as end:
            raise DriveEnded from end
