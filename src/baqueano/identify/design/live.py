"""Compute the Fisher information window by window while a vehicle drives; information.py computes the sum.

    S ← ∂x′/∂x S + ∂x′/∂θ                                                                                (1)
    F ← F + Hᵀ Q⁻¹ H,   H = ∂h/∂θ + ∂h/∂x S                                                              (2)

x is the state of the simulated vehicle, h the sensor readings, θ the parameters and the nuisance. A window is one
call of a compiled scan over (θ, x). It returns h and x with their derivatives with respect to θ and to x at the start
of the window. A missing measurement adds 0. Only the entries of x on which an output depends are kept, because the
sensors here do not measure the position of the vehicle.

    bits = −Σ log₂ σ_i                                                                                    (3)

σ_i is the standard error relative to the size of the parameter, at most 1, the prior.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.identify.design.information import Informant
from baqueano.symbolic import jacobian, scan
from baqueano.symbolic.graph.tree import Shape, build, leaves, shape_of, values

if TYPE_CHECKING:
    from baqueano.contracts.values import Tree

WINDOW_TICKS = 10  # ticks


class InformationState(NamedTuple):
    """Information of the ticks so far."""

    theta: np.ndarray  # (q,) the derivatives are computed at this θ
    x: np.ndarray  # (s,) of the simulation
    S: np.ndarray  # (s, q) ∂x/∂θ
    F: np.ndarray  # (q, q) in SI units


class RecursiveInformation:
    """Fisher information F of a drive in progress. `add` accepts any number of ticks; whole windows are fastest."""

    def __init__(self, informant: Informant) -> None:
        self.unknowns, self.nominal = informant.unknowns, informant.nominal
        begin, tick = informant.start, informant.tick
        example = begin(self.nominal)
        shape = shape_of(example, "x")
        names = [name for leaf in leaves(shape) for name in leaf.names]
        self._live_indices = [
            k
            for k, name in enumerate(names)
            if name.replace("x", "carry", 1) not in informant.kernel.unused_carry
        ]
        initial_values, q = _flatten(shape, example), len(self.nominal)

        def state_of(numbers: np.ndarray) -> "Tree":
            flat = list(initial_values)
            for k, index in enumerate(self._live_indices):
                flat[index] = numbers[q + k]
            return _unflatten(shape, flat)

        def step(numbers: np.ndarray, state: "Tree", u: np.ndarray) -> tuple["Tree", np.ndarray]:
            state, outputs = tick(numbers[:q], state, u)
            flat = _flatten(shape, state)
            return state, np.concatenate([outputs, np.array([flat[k] for k in self._live_indices])])

        numbers = np.concatenate(
            [self.nominal, np.array([initial_values[k] for k in self._live_indices], dtype=float)]
        )
        commands, backend = np.zeros(informant.commands), informant.kernel.backend
        self._kernel = scan(step, state_of, commands, numbers, backend=backend)
        self._begin = lambda theta: np.array([_flatten(shape, begin(theta))[k] for k in self._live_indices])
        self._slope = jacobian(self._begin)

    def begin(self, theta: np.ndarray | None = None) -> InformationState:
        """Return the state at the start of a drive, with F = 0.

        The derivatives are computed at `theta`, or at the nominal θ.
        """
        theta = self.nominal if theta is None else np.asarray(theta, dtype=float)
        x, S = np.asarray(self._begin(theta), dtype=float), np.asarray(self._slope(theta), dtype=float)
        return InformationState(theta, x, S, np.zeros((len(theta), len(theta))))

    def add(self, state: InformationState, u: np.ndarray, has: np.ndarray | None = None) -> InformationState:
        """Return the state after the ticks with commands `u` (N, n). `has` (N, m) is 1 for the channels that were
        measured; None means all.  (1), (2)"""
        theta, x, S, F = state
        q = len(theta)
        for offset in range(0, len(u), WINDOW_TICKS):
            outputs, derivatives = self._kernel.sensitivities(
                u[offset : offset + WINDOW_TICKS], np.concatenate([theta, x])
            )
            m = outputs.shape[1] - len(x)
            total_derivatives = derivatives[:, :, :q] + derivatives[:, :, q:] @ S
            H = (
                total_derivatives[:, :m]
                if has is None
                else total_derivatives[:, :m] * has[offset : offset + WINDOW_TICKS, :, None]
            )
            H = H.reshape(-1, q)
            x, S, F = outputs[-1, m:], total_derivatives[-1, m:], F + H.T @ H
        return InformationState(theta, x, S, F)

    def relative_std(self, state: InformationState, size: np.ndarray | None = None) -> np.ndarray:
        """Return the standard error (p,) of each parameter of interest.

        It is relative to `size` (q,), or to the size in the file if `size` is None.
        """
        size = self.unknowns.size if size is None else size
        augmented = state.F * np.outer(size, size) + np.eye(len(size))
        return np.sqrt(np.diagonal(np.linalg.inv(augmented))[: self.unknowns.interest_count])


def bits(relative_std: np.ndarray) -> float:
    """Return the information on all parameters together [bit].  (3)"""
    return float(-np.sum(np.log2(relative_std)))


def _flatten(shape: Shape, tree: "Tree") -> list["Tree"]:
    """Return all scalar entries of a tree (numbers or symbols) as one list."""
    pairs = zip(leaves(shape), values(shape, tree), strict=True)
    return [
        number
        for leaf, value in pairs
        for number in ([value[i] for i in np.ndindex(leaf.shape)] if leaf.is_array else [value])
    ]


def _unflatten(shape: Shape, numbers: list["Tree"]) -> "Tree":
    """Return the tree with these scalar entries, in the order of `_flatten`."""
    offset, leaf_values = 0, []
    for leaf in leaves(shape):
        piece, offset = numbers[offset : offset + leaf.size], offset + leaf.size
        leaf_values.append(np.array(piece).reshape(leaf.shape) if leaf.is_array else piece[0])
    return build(shape, iter(leaf_values))
