"""Parameters of n vehicles that are simulated together, and their motion at an instant."""

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np


class TruthGroup(NamedTuple):
    """Pose, velocity and acceleration of n vehicles at an instant."""

    eta: np.ndarray  # (n, 3) x, y [m], heading [rad], not wrapped
    nu: np.ndarray  # (n, 3) body frame
    nu_dot: np.ndarray  # (n, 3)


@dataclass(frozen=True)
class Group:
    """Arrays whose first axis is the vehicle, or groups of such arrays."""

    def with_parameters(self, **values: Any) -> Self:
        """Return the vehicles with the given parameters replaced."""
        return replace(self, **values)

    def subset(self, which: list[int]) -> Self:
        """Return the vehicles with the indices `which`; an index may occur several times."""
        return replace(
            self, **{k: v.subset(which) if isinstance(v, Group) else v[which] for k, v in self._all()}
        )

    def merge(self, others: "list[Self]") -> Self:
        """Return the vehicles of this group and of the `others` as one group."""
        arrays = {}
        for name, value in self._all():
            columns = [getattr(group, name) for group in others]
            arrays[name] = (
                value.merge(columns) if isinstance(value, Group) else np.concatenate([value, *columns])
            )
        return replace(self, **arrays)

    def _all(self) -> list[tuple[str, Any]]:
        return [(field.name, getattr(self, field.name)) for field in fields(self)]
