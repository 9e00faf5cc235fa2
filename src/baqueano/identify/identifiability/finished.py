"""A finished search, before its errors, its diagnostics and its verdict."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic
from baqueano.identify.blocks import FittedBlocks
from baqueano.identify.covariance.information import Information
from baqueano.identify.estimation.search import Search, Task
from baqueano.identify.identifiability.identifiable import Seen
from baqueano.identify.parameters.free import Free

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile


class FinishedFit(NamedTuple):
    """All that is known at the end."""

    file: "VehicleFile"
    blocks: FittedBlocks
    task: Task
    wanted: list[Free]  # (p,) all parameters that were asked for
    frozen: list[int]  # those whose command never moved; they are not in θ
    found: Search
    sight: Seen
    info: Information
    said: Diagnostic | None = None  # what was done before the search
    doubts: tuple[Diagnostic, ...] = ()  # about the data
    ask: bool = True  # what is not in the model
    floor: bool = False  # whether one that moves explains what a simulation leaves
    filtered: bool = False  # whether θ is that of the innovations
    systematic: np.ndarray | None = None  # (p, p) covariance of θ by what was held where it was measured

    @property
    def told(self) -> list[int]:
        """Which of `wanted` are in θ; they are its first entries, in order."""
        return [k for k in range(len(self.wanted)) if k not in self.frozen]

    @property
    def free(self) -> list[Free]:
        """Those of `wanted` that are in θ."""
        return [self.wanted[k] for k in self.told]

    def like(self, which: Mapping[int, tuple[int, ...]], i: int) -> list[Free]:
        """The shared parameters that entry i of θ is like, by `which` of its sight."""
        return [self.free[j] for j in which.get(i, ()) if j < len(self.told)]
