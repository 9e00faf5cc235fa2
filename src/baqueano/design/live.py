"""Compute the Fisher information while a vehicle drives, and advise the motion that a person should drive next.

    S ← ∂x′/∂x S + ∂x′/∂θ                                                                                (1)
    F ← F + Hᵀ Q⁻¹ H,   H = ∂h/∂θ + ∂h/∂x S,     bits = −Σ log₂ σ_i                                       (2)
    k, i = argmin log(σ_i² + GOAL_STD²) − log(σ_i,now² + GOAL_STD²),   σ of F + F_k                       (3)

x is the state of the simulated vehicle, h the sensor readings, θ the parameters and the nuisance. A window is one
call of a compiled scan over (θ, x); it returns h and x with their derivatives. A missing measurement adds 0. Only the
entries of x on which an output depends are kept, because the sensors here do not measure the position. σ_i is the
standard error relative to the size of the parameter, at most 1, the prior.

F_k is the information of the k-th motion from rest. (3) is the first step of the search of compose.py, without walls,
over motions with a name: the vehicle returns on the same path, or continues in circles. It considers only the
parameter whose error decreases most. For an error below GOAL_STD the decrease has little weight.
"""

from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.design.compose import RETURN_KINDS, MotionPrimitive
from baqueano.design.information import DriveInformation
from baqueano.diagnostics import Diagnostic, note
from baqueano.symbolic import jacobian, scan
from baqueano.symbolic.graph.tree import Shape, build, leaves, tree_shape, values

WINDOW_TICKS = 10  # ticks


class InformationState(NamedTuple):
    """Information of the ticks so far."""

    theta: np.ndarray  # (q,) the derivatives are computed at this θ
    x: np.ndarray  # (s,) of the simulation
    S: np.ndarray  # (s, q) ∂x/∂θ
    F: np.ndarray  # (q, q) in SI units


class RecursiveInformation:
    """Fisher information F of a drive in progress. `add` accepts any number of ticks; whole windows are fastest."""

    def __init__(self, drive_information: DriveInformation) -> None:
        self.unknowns, self.nominal = drive_information.unknowns, drive_information.nominal
        begin, tick = drive_information.start, drive_information.tick
        example = begin(self.nominal)
        shape = tree_shape(example, "x")
        names = [name for leaf in leaves(shape) for name in leaf.names]
        unused_carry = drive_information.kernel.unused_carry
        self._live_indices = [
            k for k, n in enumerate(names) if n.replace("x", "carry", 1) not in unused_carry
        ]
        initial_values, q = _flatten(shape, example), len(self.nominal)

        def state_tree(numbers: np.ndarray) -> Tree:
            flat_values = list(initial_values)
            for k, index in enumerate(self._live_indices):
                flat_values[index] = numbers[q + k]
            return _unflatten(shape, flat_values)

        def step(numbers: np.ndarray, state: Tree, u: np.ndarray) -> tuple[Tree, np.ndarray]:
            state, outputs = tick(numbers[:q], state, u)
            flat_values = _flatten(shape, state)
            return state, np.concatenate([outputs, np.array([flat_values[k] for k in self._live_indices])])

        numbers = np.array([*self.nominal, *(initial_values[k] for k in self._live_indices)], dtype=float)
        commands, backend = np.zeros(drive_information.commands), drive_information.kernel.backend
        self._kernel = scan(step, state_tree, commands, numbers, backend=backend)
        self._begin = lambda theta: np.array([_flatten(shape, begin(theta))[k] for k in self._live_indices])
        self._derivative = jacobian(self._begin)

    def begin(self, theta: np.ndarray | None = None) -> InformationState:
        """Return the state at the start of a drive, with F = 0. The derivatives are computed at `theta`, or at the
        nominal θ."""
        theta = self.nominal if theta is None else np.asarray(theta, dtype=float)
        x, S = np.asarray(self._begin(theta), dtype=float), np.asarray(self._derivative(theta), dtype=float)
        return InformationState(theta, x, S, np.zeros((len(theta), len(theta))))

    def add(self, state: InformationState, u: np.ndarray, mask: np.ndarray | None = None) -> InformationState:
        """Return the state after the ticks with commands `u` (N, n). `mask` (N, m) is 1 for the channels that were
        measured; None means all.  (1), (2)"""
        theta, x, S, F = state
        q = len(theta)
        for offset in range(0, len(u), WINDOW_TICKS):
            window = slice(offset, offset + WINDOW_TICKS)
            outputs, derivatives = self._kernel.sensitivities(u[window], np.concatenate([theta, x]))
            m = outputs.shape[1] - len(x)
            total_derivatives = derivatives[:, :, :q] + derivatives[:, :, q:] @ S
            H = total_derivatives[:, :m] * (1.0 if mask is None else mask[window, :, None])
            H = H.reshape(-1, q)
            x, S, F = outputs[-1, m:], total_derivatives[-1, m:], F + H.T @ H
        return InformationState(theta, x, S, F)

    def relative_std(self, state: InformationState, size: np.ndarray | None = None) -> np.ndarray:
        """Return the standard error (p,) of each parameter of interest. It is relative to `size` (q,), or to the size
        in the file if `size` is None."""
        size = self.unknowns.size if size is None else size
        augmented_information = state.F * np.outer(size, size) + np.eye(len(size))
        return np.sqrt(np.diagonal(np.linalg.inv(augmented_information))[: self.unknowns.interest_count])


def information_bits(relative_std: np.ndarray) -> float:
    """Return the information on all parameters together [bit].  (2)"""
    return float(-np.sum(np.log2(relative_std)))


def _flatten(shape: Shape, tree: Tree) -> list[Tree]:
    """Return all scalar entries of a tree (numbers or symbols) as one list."""
    pairs = zip(leaves(shape), values(shape, tree), strict=True)
    return [
        number
        for leaf, value in pairs
        for number in ([value[i] for i in np.ndindex(leaf.shape)] if leaf.is_array else [value])
    ]


def _unflatten(shape: Shape, numbers: list[Tree]) -> Tree:
    """Return the tree with these scalar entries, in the order of `_flatten`."""
    offset, leaf_values = 0, []
    for leaf in leaves(shape):
        scalars, offset = numbers[offset : offset + leaf.size], offset + leaf.size
        leaf_values.append(np.array(scalars).reshape(leaf.shape) if leaf.is_array else scalars[0])
    return build(shape, iter(leaf_values))


MOTION_S = 4.0
LEVELS = (1.0, 0.6, 0.35)  # fraction of the limit
GOAL_STD = 0.01  # relative standard error that is good enough
STEP_S = 0.4  # between sudden changes
RETURN_REVERSED, NO_RETURN = 0, RETURN_KINDS - 1


class SuggestedMotion(NamedTuple):
    """A motion in words and as commands."""

    words: Diagnostic
    u: np.ndarray  # (T, n)


class NextMotion(NamedTuple):
    """The motion to drive next, and the standard error of the parameter whose error it reduces most."""

    words: Diagnostic
    parameter: int  # index among those of interest
    error_before: float  # relative standard error
    error_after: float


def named_motions(limit: np.ndarray, rate_hz: float) -> list[SuggestedMotion]:
    """Return motions within the limits. The first usable channel moves forward, the last one turns. Return [] without a
    usable channel."""
    moving_axes, ticks = np.flatnonzero(limit > 0.0), round(MOTION_S * rate_hz)
    if not len(moving_axes):
        return []
    forward_axis, turning_axis = moving_axes[0], moving_axes[-1]
    kinds = [("straight", (forward_axis,), RETURN_REVERSED)]
    if turning_axis != forward_axis:
        kinds += [
            ("turn", (turning_axis,), RETURN_REVERSED),
            ("curve", (forward_axis, turning_axis), RETURN_REVERSED),
        ]
        kinds += [("circle", (forward_axis, turning_axis), NO_RETURN)]
    t = np.arange(ticks) / rate_hz
    shapes = {
        "steady": np.ones(ticks), "steps": np.where(np.floor(t / STEP_S) % 2 == 0.0, 1.0, 0.0),
        "ramp": np.minimum(1.0, 2.0 * t / MOTION_S),
    }  # fmt: skip
    motions = []
    for kind, channels, return_kind in kinds:
        for shape_name, shape in shapes.items():
            for level in LEVELS if shape_name == "steady" else LEVELS[:1]:
                outbound = np.zeros((ticks, len(limit)))
                outbound[:, list(channels)] = level * shape[:, None]
                words = note(f"motion.{kind}-{shape_name}", percent=round(100.0 * level), t_s=MOTION_S)
                motions.append(SuggestedMotion(words, MotionPrimitive(outbound, return_kind).u(ticks, limit)))
    return motions


class MotionAdvisor:
    """The motions of a vehicle, and the information of each at θ."""

    def __init__(self, drive_information: DriveInformation, limit: np.ndarray, rate_hz: float) -> None:
        self._drive_information, self._motions = drive_information, named_motions(limit, rate_hz)
        self._F, self._theta = np.zeros(0), np.zeros(0)  # of each motion, at θ

    def next_motion(
        self, F: np.ndarray, theta: np.ndarray, size: np.ndarray, widening: np.ndarray
    ) -> NextMotion | None:
        """Return the motion that, after a drive with information F (q, q) [SI units], most reduces the error of one
        parameter. (3) Return None for a vehicle without motions. `size` (q,) contains the sizes of the parameters.
        `widening` (p,) is the ratio of the errors of a fit to the errors that F predicts."""
        if not self._motions:
            return None
        if not np.array_equal(theta, self._theta):
            drive_info, scale = self._drive_information, self._drive_information.unknowns.size
            informations = [drive_info.information(motion.u, theta) for motion in self._motions]
            self._F, self._theta = np.stack(informations) / np.outer(scale, scale), theta
        D, relative_std = np.outer(size, size), self._drive_information.relative_std
        present_std = np.minimum(widening * relative_std(F * D), 1.0)
        expected_std = np.minimum([widening * relative_std((F + gain) * D) for gain in self._F], 1.0)
        gain = np.log(present_std**2 + GOAL_STD**2) - np.log(expected_std**2 + GOAL_STD**2)
        k, i = np.unravel_index(np.argmax(gain), gain.shape)
        return NextMotion(self._motions[k].words, int(i), float(present_std[i]), float(expected_std[k, i]))
