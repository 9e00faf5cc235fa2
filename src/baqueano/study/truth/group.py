"""Parameters of n vehicles that are simulated together, and their motion at an instant."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

GroupType = TypeVar("GroupType", bound="Group")


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

    def subset(self, indices: list[int]) -> Self:
        """Return the vehicles with the indices `indices`; an index may occur several times."""
        return replace(
            self, **{k: v.subset(indices) if isinstance(v, Group) else v[indices] for k, v in self._all()}
        )

    def _all(self) -> list[tuple[str, Any]]:
        return [(field.name, getattr(self, field.name)) for field in fields(self)]


def merge(groups: Sequence[GroupType]) -> GroupType:
    """Return the vehicles of all groups as one group."""
    arrays = {}
    for name, value in groups[0]._all():
        columns = [getattr(group, name) for group in groups]
        arrays[name] = merge(columns) if isinstance(value, Group) else np.concatenate(columns)
    return replace(groups[0], **arrays)
