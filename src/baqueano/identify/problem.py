"""The residuals of a simulation as one kernel, and the sum over runs of what the kernel says.

    x_k = step(vehicle(θ), x_{k−1}, u_k, dt_k),   x_0 from ν₀                                             (1)
    r_k = W_k (z_k − h_θ(x_k))                                                                            (2)

W holds 1/σ of each channel, 0 where nothing was measured: a row of the kernel's input is (dt, u, z, W),
and for sensors whose stamps lie between ticks the part of the step by which they do; there
h = h_k + early (h_{k−1} − h_k). The model is simulated from its start to the end without ever looking at
a measurement: the paper's cost, `equ:cost_function`, simulation error.

θ is one vector: what all runs share, then for each run its sensor biases and its ν₀. A kernel belongs to
the structure of a fit and to the numbers that are not free; it is kept for the next fit.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.identify.least_squares import Evaluation
from baqueano.identify.parameters import Blocks, value, with_numbers
from baqueano.identify.record import Record
from baqueano.signals import Motion, sensor_slots
from baqueano.symbolic import put, scan
from baqueano.vehicles.delay import delayed

HUBER = 1.345  # in standard deviations: 95 % efficient on normal noise
KEPT = 24  # kernels
_kernels: "OrderedDict[Any, Any]" = OrderedDict()


class Moving(NamedTuple):
    """What the simulation carries."""

    vehicle: Any
    past: tuple[np.ndarray, ...]  # per sensor, its line of delayed signals (slots, m)
    before: tuple[np.ndarray, ...]  # per sensor, h of the row before (m,); (0,) where it is not needed


class Shape(NamedTuple):
    """What θ of one run means."""

    shared: tuple[str, ...]  # paths that all runs share
    own: tuple[str, ...]  # paths that each run has for itself: biases
    start: tuple[int, ...]  # entries of ν₀ that are free
    early: tuple[bool, ...]  # per sensor, whether its stamps lie between ticks

    @property
    def size(self) -> int:
        """Length of θ of one run."""
        return len(self.shared) + len(self.own) + len(self.start)


class Problem:
    """The residuals of several runs as a function of one θ."""

    def __init__(
        self, blocks: Blocks, shape: Shape, records: Sequence[Record], backend: str = "auto"
    ) -> None:
        self.shape, self.records = shape, tuple(records)
        self.names: tuple[str, ...] = blocks.sensors._fields
        self.sizes = [s.size for s in blocks.sensors]
        self.scan = _kernel(blocks, shape, backend)
        self._rows = [_rows(record, self.names, shape) for record in self.records]
        s, o = len(shape.shared), shape.size - len(shape.shared)
        self._index = [
            np.concatenate([np.arange(s), np.arange(s + r * o, s + (r + 1) * o)]) for r in range(len(records))
        ]
        self.size = s + o * len(records)
        m, n = sum(self.sizes), blocks.model.commands
        self._weights = slice(1 + n + m, 1 + n + 2 * m)
        self._has = [rows[:, self._weights].copy() for rows in self._rows]
        self.z = [rows[:, 1 + n : 1 + n + m].copy() for rows in self._rows]
        self.sigma = np.ones(m)

    @property
    def has(self) -> list[np.ndarray]:
        """Per run (N, m): 1 where there is a measurement."""
        return self._has

    def signal(self) -> np.ndarray:
        """(m,) standard deviation of the measurements of each channel, over all runs."""
        out = np.zeros(len(self.sigma))
        for c in range(len(out)):
            said = [z[has[:, c] > 0.0, c] for z, has in zip(self.z, self._has, strict=True)]
            out[c] = np.std(np.concatenate(said)) if any(map(len, said)) else 0.0
        return out

    def weigh(self, sigma: np.ndarray) -> None:
        """From now on the residuals are divided by `sigma` (m,)."""
        self.sigma = sigma
        for rows, has in zip(self._rows, self._has, strict=True):
            np.divide(has, sigma, out=rows[:, self._weights])

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        """Huber cost, gradient (p,), Σ w ∂r ∂rᵀ (p, p), summed over the runs."""
        return self._summed(theta, HUBER)

    def information(self, theta: np.ndarray, factors: Sequence[np.ndarray]) -> np.ndarray:
        """Σ f² ∂r ∂rᵀ (p, p), with a factor f (N, m) per run for each residual."""
        keep = [rows[:, self._weights].copy() for rows in self._rows]
        for rows, factor in zip(self._rows, factors, strict=True):
            rows[:, self._weights] *= factor
        hessian = self._summed(theta, None).hessian
        for rows, was in zip(self._rows, keep, strict=True):
            rows[:, self._weights] = was
        return hessian

    def _summed(self, theta: np.ndarray, huber: float | None) -> Evaluation:
        if len(self._rows) == 1:
            return Evaluation(*self.scan.normal_equations(self._rows[0], theta, huber))
        cost, g, H = 0.0, np.zeros(self.size), np.zeros((self.size, self.size))
        for rows, index in zip(self._rows, self._index, strict=True):
            c, g_r, H_r = self.scan.normal_equations(rows, theta[index], huber)
            cost += c
            g[index] += g_r
            H[np.ix_(index, index)] += H_r
        return Evaluation(cost, g, H)

    def residuals(self, theta: np.ndarray) -> list[np.ndarray]:
        """Per run r (N, m) in standard deviations; 0 where there is no measurement."""
        return [
            np.asarray(self.scan.run(rows, theta[index])[1])
            for rows, index in zip(self._rows, self._index, strict=True)
        ]

    def sensitivities(self, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Per run r (N, m), ∂r (N, m, p_run), and where the p_run entries stand in θ."""
        return [
            (*self.scan.sensitivities(rows, theta[index]), index)
            for rows, index in zip(self._rows, self._index, strict=True)
        ]

    def predictions(self, theta: np.ndarray) -> list[np.ndarray]:
        """Per run h (N, m), also where nothing was measured."""
        keep = [rows.copy() for rows in self._rows]
        for rows in self._rows:
            rows[:, self._weights] = 1.0
        out = [z - r for z, r in zip(self.z, self.residuals(theta), strict=True)]
        for rows, was in zip(self._rows, keep, strict=True):
            rows[:] = was
        return out


def _rows(record: Record, names: Sequence[str], shape: Shape) -> np.ndarray:
    """(N, q): dt, u, z of all sensors, W of all sensors, early of those that need it."""
    said = [record.sensors[name] for name in names]
    columns = [record.dt_s[:, None], record.u, *(s.z for s in said), *(s.has for s in said)]
    for s, needed in zip(said, shape.early, strict=True):
        if needed:
            columns.append(np.zeros((len(record.dt_s), 1)) if s.early is None else s.early[:, None])
    return np.ascontiguousarray(np.concatenate(columns, axis=1))


def _kernel(blocks: Blocks, shape: Shape, backend: str) -> Any:
    folded = blocks
    for path in (*shape.shared, *shape.own):
        folded = put(folded, path, 0.0)
    key = (_print(folded), shape, backend)
    if key not in _kernels:
        _kernels[key] = _traced(blocks, shape, backend)
        if len(_kernels) > KEPT:
            _kernels.popitem(last=False)
    _kernels.move_to_end(key)
    return _kernels[key]


def _traced(blocks: Blocks, shape: Shape, backend: str) -> Any:
    n, sizes = blocks.model.commands, [s.size for s in blocks.sensors]
    m, paths = sum(sizes), (*shape.shared, *shape.own)

    def start(theta: np.ndarray) -> Moving:
        there = with_numbers(blocks, paths, theta)
        nu = np.zeros(3)
        for k, i in enumerate(shape.start):
            nu = nu + theta[len(paths) + k] * np.eye(3)[i]
        past = tuple(np.zeros((getattr(s, "delay_slots", 0), s.size)) for s in blocks.sensors)
        before = tuple(np.zeros(k if e else 0) for k, e in zip(sizes, shape.early, strict=True))
        return Moving(there.model.init(nu=nu) if shape.start else there.model.init(), past, before)

    def step(theta: np.ndarray, state: Moving, row: np.ndarray) -> tuple[Moving, np.ndarray]:
        there = with_numbers(blocks, paths, theta)
        dt_s, u = row[0], row[1 : 1 + n]
        z, weight, early = row[1 + n : 1 + n + m], row[1 + n + m : 1 + n + 2 * m], row[1 + n + 2 * m :]
        vehicle, motion = there.model.step(state.vehicle, u, dt_s, np.zeros(3))
        felt, past = _felt(there.sensors, motion, state.past, dt_s)
        out, before, at, turn = [], [], 0, 0
        for k, sensor in enumerate(there.sensors):
            h = felt[k]
            if shape.early[k]:
                h = h + early[turn] * (state.before[k] - h)
                turn += 1
            before.append(felt[k] if shape.early[k] else state.before[k])
            span = slice(at, at + sizes[k])
            out.append(weight[span] * difference(sensor, z[span], h))
            at += sizes[k]
        return Moving(vehicle, past, tuple(before)), np.concatenate(out)

    q = 1 + n + 2 * m + sum(shape.early)
    example = np.array([*(value(blocks, path) for path in paths), *np.zeros(len(shape.start))])
    return scan(step, start, np.zeros(q), example, backend=backend)


def _felt(
    sensors: Any, motion: Motion, past: tuple[np.ndarray, ...], dt_s: Any
) -> tuple[list[np.ndarray], tuple[np.ndarray, ...]]:
    """What each sensor shows now (m,), its delay included, and the lines of the past."""
    shown, kept = [], []
    for sensor, line in zip(sensors, past, strict=True):
        h = sensor.h(motion)
        if getattr(sensor, "delay_slots", 0) > 0:
            line, h = delayed(line, h, sensor.delay_s, dt_s)
        shown.append(h)
        kept.append(line)
    return shown, tuple(kept)


def difference(sensor: Any, z: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """z − h (m,); a sensor of angles brings its own."""
    return sensor.difference(z, expected) if hasattr(sensor, "difference") else z - expected


def chosen_sensors(sensors: Any, names: Sequence[str]) -> Any:
    """The NamedTuple of the named sensor blocks."""
    return sensor_slots(tuple(names))(*(getattr(sensors, name) for name in names))


def _print(tree: Any) -> Any:
    """A hashable copy of all numbers in a tree of blocks: two trees with the same print trace alike."""
    if is_dataclass(tree) and not isinstance(tree, type):
        return (type(tree), *(_print(getattr(tree, f.name)) for f in fields(tree)))
    if isinstance(tree, np.ndarray):
        return (tree.shape, tree.tobytes())
    if isinstance(tree, tuple | list):
        return (type(tree), *map(_print, tree))
    if isinstance(tree, dict):
        return tuple((k, _print(v)) for k, v in tree.items())
    return id(tree) if isinstance(tree, Callable) else tree
