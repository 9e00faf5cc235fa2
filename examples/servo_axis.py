"""Model a carriage on a rail, pulled by a belt and a motor: one degree of freedom, volts in, dry friction.

v̇ = k u − d v − c tanh(v/0.003)
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.parameter import parameter
from baqueano.vehicles import AccelerationModel


@dataclass(frozen=True, slots=True, eq=False)
class ServoAxis(AccelerationModel):
    """A servo axis: u = (volts,); all parameters are per kilogram of the moving mass."""

    commands: ClassVar[int] = 1
    axes: ClassVar[tuple[int, ...]] = (0,)

    gain: float = parameter(
        "m/s² per V", "acceleration of a volt, k", low=0.0, high=1e3, role="gain",
        shown_by="steps of the voltage", symbol="k",
    )  # fmt: skip
    damping: float = parameter(
        "1/s", "back EMF and grease, d", low=0.0, high=1e4, shown_by="long strokes at several voltages",
        symbol="d",
    )  # fmt: skip
    rail: float = parameter(
        "m/s²", "dry friction of the rail, c", low=0.0, high=1e3, default=0.0, role="term",
        term="dry friction of the rail", shown_by="slow strokes that stop and turn, many times", symbol="c",
    )  # fmt: skip

    def nu_dot(self, nu: np.ndarray, effort: np.ndarray, psi: float = 0.0) -> np.ndarray:
        """Return ν̇ (3,) [m/s², m/s², rad/s²] at ν (3,) with the voltage `effort` (1,)."""
        v = nu[0]
        return np.array([self.gain * effort[0] - self.damping * v - self.rail * np.tanh(v / 0.003), 0.0, 0.0])
