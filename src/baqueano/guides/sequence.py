"""Two guides, one after the other: the path onto a route and the route, or a route and the path back to its start.

    first  until it is done,  then second                                                                 (1)
    if `first` drives to a route: second begins at the time τ and the speed at which `first` arrived       (2)

If the second guide does not have `entry_state`, it first receives an estimate whose timestamp is τ earlier.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Guide
from baqueano.contracts.values import Tree, Value
from baqueano.guides.drive_to import DriveTo
from baqueano.guides.route import Route
from baqueano.signals import NANOSECONDS, Estimate, Reference
from baqueano.symbolic import branch

START_TOLERANCES = {
    "tolerance_m": 0.05,
    "tolerance_rad": np.radians(10.0),
}  # the controllers end a route within this


class GuideSequenceState(NamedTuple):
    """The states of both guides, and a flag: 1 after the end of the first guide."""

    first: Tree
    second: Tree
    is_first_done: float  # 1.0 after the first guide is done


@dataclass(frozen=True, slots=True, eq=False)
class GuideSequence:
    """Guide that follows one guide until it is done, and then another.

    Parameters
    ----------
    first, second : Guide
        The guides.
    starts_at_entry : bool
        True if `first` is a DriveTo onto the route of `second`.

    Notes
    -----
    Equations (1) and (2) of the module.

    Examples
    --------
    >>> from baqueano.guides import Repeat
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.signals import Estimate
    >>> lap = circle(0.5, 0.2)
    >>> guide = GuideSequence.with_lead_in(Repeat.along(lap), lap)
    >>> beside = Estimate(0, np.array([0.0, 0.2, 0.0]), np.zeros(3), np.eye(6))
    >>> print(guide.step(guide.init(), beside)[1].eta)  # it begins where the vehicle stands
    [0.  0.2 0. ]
    """

    inner_blocks: ClassVar[tuple[str, ...]] = ("first", "second")

    first: Tree
    second: Tree
    starts_at_entry: bool = False

    @classmethod
    def with_lead_in(cls, guide: Guide, route: Route, **limits: Value) -> "GuideSequence":
        """Return the guide with a path from the vehicle's pose onto its route; `limits` are arguments of DriveTo."""
        return cls(DriveTo.to_route(route, **limits), guide, True)

    @classmethod
    def with_way_back(cls, guide: Guide, route: Route, **limits: Value) -> "GuideSequence":
        """Return the guide with a path back to the start of its route; `limits` are arguments of DriveTo.

        A vehicle at the start, as after a lap, stays there: it would need a loop to come nearer.
        """
        return cls(guide, DriveTo(route.eta[:1], **START_TOLERANCES | limits))

    @property
    def is_interpreted(self) -> bool:
        """Return True if a part computes a path, which is not compiled; the other parts are compiled on their own."""
        return any(type(part) is DriveTo for part in optional.nested_blocks(self))

    def init(self) -> GuideSequenceState:
        """Return the state at the start of the first guide."""
        return GuideSequenceState(self.first.init(), self.second.init(), 0.0)

    def step(self, state: Tree, estimate: Estimate) -> tuple[Tree, Reference]:
        """Return the state, and the reference of the present guide: `first` until it is done, then `second`.  (1)"""
        was_first_done = state.is_first_done > 0.0
        if was_first_done is True:
            second, reference = self.second.step(state.second, estimate)
            return GuideSequenceState(state.first, second, 1.0), reference
        end_reference = Reference(estimate.t_ns, estimate.eta, np.zeros(3), 1.0)
        first, reference = branch(
            was_first_done,
            lambda: (state.first, end_reference),
            lambda: self.first.step(state.first, estimate),
        )

        def step_second_guide() -> Tree:
            entry = branch(was_first_done, lambda: state.second, lambda: self._entry(first, estimate))
            return (*self.second.step(entry, estimate), 1.0)

        second, reference, is_first_done = branch(
            reference.at_end > 0.0,
            step_second_guide,
            lambda: (state.second, reference._replace(at_end=0.0), 0.0),
        )
        return GuideSequenceState(first, second, is_first_done), reference

    def _entry(self, first: Tree, estimate: Estimate) -> Tree:
        """Return the state at which the second guide begins.  (2)"""
        if not self.starts_at_entry:
            return self.second.init()
        tau_s = first.goal[0]
        entry_state = optional.attribute(self.second, "entry_state")
        if entry_state is not None:
            return entry_state(estimate.t_ns, tau_s, first.v_m_s)
        shifted_estimate = estimate._replace(t_ns=estimate.t_ns - np.rint(tau_s * NANOSECONDS))
        return self.second.step(self.second.init(), shifted_estimate)[0]
