"""Compute the residuals of a simulation with one kernel, and their sums over runs.

    x_k = step(vehicle(θ), x_{k−1}, u_k, dt_k),   x_0 from ν₀                                             (1)
    r_k = W_k (z_k − h_θ(x_k))                                                                            (2)

W is 1/σ of each channel, 0 without a measurement. A row of the kernel's input is (dt, u, z, W). For timestamps between
ticks the row ends with `early`, a part of the step; then h = h_k + early (h_{k−1} − h_k). If a sensor's clock is free,
h is read from a delay line (data/record.py). Readings that are means are compared with means of h (data/averaging.py);
if their clock is free, ∫ h dt is in the delay line.
The model is simulated from its start to the end without a correction by measurements. The cost is the simulation error,
`equ:cost_function` of Grotz et al. docs/derivations/residuals_and_sensitivities.md gives the details.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.identify.data.added_channels import VOLTAGE_KEY
from baqueano.identify.data.averaging import WEIGHT_COLUMNS, delayed_average
from baqueano.identify.data.record import FitRecord, FittedBlocks
from baqueano.identify.parameters.theta import ThetaShape, arrow_layout, theta_layout
from baqueano.identify.residuals.informative_rows import informative_rows
from baqueano.identify.residuals.motion import (
    Motions,
    cached_kernel,
    example,
    initial_state,
    make_row_blocks,
    mean_columns,
    motion_kernel,
    motion_rows,
    read_sensors,
)
from baqueano.numerics.noise_level import speed_profile
from baqueano.numerics.normal_equations import Evaluation, segment_sum
from baqueano.numerics.parallel import parallel_map
from baqueano.numerics.statistics import HUBER, huber_cost
from baqueano.sensors.sampling import difference
from baqueano.symbolic import scan
from baqueano.symbolic.scan import Scan
from baqueano.vehicles.delay import delayed_value, with_newest_value

CACHED_RESULTS = 3  # cached results of a problem: several tests need the results at the end of a search
START_STD = (10.0, 0.3, 10.0)  # m/s, m/s, rad/s: prior of ν of a start without earlier measurements


class SimulationState(NamedTuple):
    """State of the simulation."""

    vehicle: Tree
    signals: tuple[Tree, ...]  # per sensor, its past
    previous_h: tuple[np.ndarray, ...]  # per sensor, h of the previous row (m,); (0,) if it is not needed
    lines: tuple[np.ndarray, ...]  # per sensor, h of earlier rows (slots, m); (0, m) if not needed
    steps_s: np.ndarray  # (slots,) the steps between them


class Residuals:
    """Residuals of several runs as a function of one θ. They are immutable: `weight` returns new residuals.

    A custom residual is a subclass with another `difference`.

    Parameters
    ----------
    blocks : FittedBlocks
        The model, and the sensors that are used.
    shape : ThetaShape
        Meaning of θ for one segment of a run.
    records : sequence of FitRecord
        Rows of each segment.
    backend : str
        "auto", "c", "python" or "numpy".

    Examples
    --------
    >>> from baqueano.identify import dataset, parameters_of
    >>> small, u = bq.load("small"), np.full((50, 3), [0.5, 0.0, 0.2])
    >>> parameters = parameters_of(dataset([bq.simulate(small, u)], small), ["model.mass_kg"])
    >>> [r.shape for r in Residuals.from_parameters(parameters).residuals(parameters.start)]
    [(50, 3)]"""

    has_speed_noise = False  # True if the noise always grows with speed
    depends_on_fit = False  # True if `at_estimate` changes the residuals
    has_fixed_scales = False  # True if the readings never show the scales of the IMU

    @staticmethod
    def difference(sensor: Any, z: np.ndarray, h: np.ndarray) -> np.ndarray:
        """Return the residual (m,) of a reading `z` (m,) of a sensor and the model's `h` (m,), before its weight."""
        return difference(sensor, z, h)

    def __init__(
        self, blocks: FittedBlocks, shape: ThetaShape, records: Sequence[FitRecord], backend: str = "auto"
    ) -> None:
        self.records = tuple(records)
        self.names: tuple[str, ...] = blocks.sensors._fields
        self.sizes = [s.size for s in blocks.sensors]
        self.blocks = blocks
        row_count = sum(len(record.dt_s) for record in self.records)
        # per segment the input rows (N, q) of its kernel, and 1 at each measurement (N, m)
        self.rows = parallel_map(lambda x: _rows(x, self.names, shape), self.records, rows=row_count)
        m, n = sum(self.sizes), blocks.model.commands
        self._weights = slice(1 + n + m, 1 + n + 2 * m)
        self.masks = [rows[:, self._weights].copy() for rows in self.rows]
        self.counts = np.sum([mask.sum(axis=0) for mask in self.masks], axis=0)  # (m,) over all runs
        for rows in self.rows:
            rows.flags.writeable = False
        self.z = [rows[:, 1 + n : 1 + n + m].copy() for rows in self.rows]
        self.sigma = np.ones(m)
        self.weights = self.masks  # per segment (N, m), 1/σ of each measurement, 0 without one
        self._profile: Sequence[np.ndarray] | None = None
        self._set_shape(shape, backend)

    def _set_shape(self, shape: ThetaShape, backend: str) -> None:
        """Set the meaning of θ, and every value that depends on it."""
        self.shape, self.scan = shape, self._kernel(shape, backend)
        self.layout = theta_layout(shape, self.records)
        self._index, self._arrow_layout = self.layout.indices, arrow_layout(self.layout)
        self.size = self.layout.size
        self.prior = self._start_prior()
        self._results: OrderedDict[tuple[str, bytes], Any] = OrderedDict()
        self._slopes: tuple[bytes | None, list[Any]] = None, []  # θ, and the sensitivities there

    def _kernel(self, shape: ThetaShape, backend: str) -> Scan:
        """Return the scan from rows and θ to the residuals."""
        return cached_kernel(self.blocks, shape, backend, _trace, self.difference)

    def with_paths(self, paths: Sequence[str]) -> Self:
        """Return the residuals as a function of more shared parameters, which follow the others in θ."""
        if not paths:
            return self
        residuals = copy(self)
        shape = self.shape._replace(shared_paths=(*self.shape.shared_paths, *paths))
        residuals._set_shape(shape, self.scan.backend)
        return residuals

    @classmethod
    def from_parameters(cls, parameters: Any, backend: str = "auto") -> Self:
        """Return the residuals of `parameters` (parameters/theta.py) over all their rows."""
        return cls(parameters.blocks, parameters.shape, parameters.records, backend)

    @property
    def labels(self) -> list[str]:
        """Return the names (m,) of the channels, such as "imu[2]"."""
        return [f"{name}[{i}]" for name, m in zip(self.names, self.sizes, strict=True) for i in range(m)]

    @property
    def spans(self) -> dict[str, slice]:
        """Return the channels of each sensor, as positions among all m channels."""
        ends = np.cumsum(self.sizes).tolist()
        return {name: slice(end - m, end) for name, m, end in zip(self.names, self.sizes, ends, strict=True)}

    def signal_std(self) -> np.ndarray:
        """Return the standard deviation (m,) of the measurements of each channel, over all runs."""

        def channel_std(c: int) -> float:
            columns = [z[mask[:, c] > 0.0, c] for z, mask in zip(self.z, self.masks, strict=True)]
            return float(np.std(np.concatenate(columns))) if any(map(len, columns)) else 0.0

        return np.array(parallel_map(channel_std, range(len(self.sigma)), rows=sum(map(len, self.z))))

    def weight(self, sigma: np.ndarray, profile: Sequence[np.ndarray] | None = None) -> Self:
        """Return the residuals divided by `sigma` (m,), and by `profile` (N, m) per segment if the noise varies."""
        if sigma is self.sigma and profile is self._profile:
            return self
        weights = [
            mask / sigma if shape is None else mask / (sigma * shape)
            for mask, shape in zip(self.masks, profile or [None] * len(self.masks), strict=True)
        ]
        residuals = self.with_columns(self._weights, weights)
        residuals.sigma, residuals._profile, residuals.weights = sigma, profile, weights
        return residuals

    def with_columns(self, columns: Any, values: Sequence[np.ndarray]) -> Self:
        """Return a copy with `values` (N, k) per segment in the columns `columns` of its rows."""
        residuals = copy(self)
        residuals.rows = self._map_segments(lambda rows, index, x: _fill(rows, columns, x), values)
        residuals._results, residuals._slopes = OrderedDict(), (None, [])
        return residuals

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        """Return the Huber cost, its gradient (p,), and Σ w ∂r ∂rᵀ (p, p), summed over the runs."""
        if len(self.rows) == 1 and not self.prior.any():
            return Evaluation(*self.scan.normal_equations(self.rows[0], theta, HUBER))
        parts = self._map_segments(
            lambda rows, index: Evaluation(*self.scan.normal_equations(rows, theta[index], HUBER))
        )
        return segment_sum(parts, self._index, theta, self.prior, self._arrow_layout)

    def at_estimate(self, theta: np.ndarray) -> Self:
        """Return the residuals with every value that depends on a fit, computed at θ (p,)."""
        return self

    def cost(self, theta: np.ndarray, replace_rows: Callable[[np.ndarray], np.ndarray]) -> float:
        """Return the Huber cost at θ, with the rows of each segment replaced by `replace_rows(rows)`."""

        def segment_cost(rows: np.ndarray, index: np.ndarray) -> float:
            return huber_cost(self.scan.run(np.ascontiguousarray(replace_rows(rows)), theta[index])[1])

        return sum(self._map_segments(segment_cost))

    def _start_prior(self) -> np.ndarray:
        """Return the weight (p,) of a prior at 0 for start velocities, else 0. Tyres stop a slip immediately; without
        the prior, slip and speed can diverge together. So can the yaw rate of a car without a lag of its tyres."""
        prior = np.zeros(self.size)
        weight = [START_STD[i] ** -2 if i < len(START_STD) else 0.0 for i in self.shape.start]
        for k in range(len(self.masks)):
            prior[self.layout.start_slice(k)] = weight
        return prior

    def _map_segments(self, work: Callable[..., Any], *arguments: Sequence[Any]) -> list[Any]:
        """Return `work(rows, index, …)` for each segment, on all cores if that is faster."""
        rows = sum(map(len, self.rows)) if self.scan.backend == "c" else 0
        return parallel_map(work, self.rows, self._index, *arguments, rows=rows)

    def residuals(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return for each segment r (N, m) in standard deviations, 0 without a measurement. Do not modify it."""

        def work() -> list[np.ndarray]:
            return self._map_segments(lambda rows, i: np.asarray(self.scan.run(rows, theta[i])[1]))

        return self._cached("residuals", theta, work)

    def misfits(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return for each segment z − h (N, m) in the sensors' units, 0 without a measurement."""
        pairs = zip(self.residuals(theta), self.weights, strict=True)
        return [r / np.where(weight > 0.0, weight, 1.0) for r, weight in pairs]

    def motions(self, theta: np.ndarray) -> list[Motions]:
        """Return for each segment the motion and the predictions of the model, without timestamps between ticks."""
        kernel = cached_kernel(self.blocks, self.shape, self.scan.backend, motion_kernel)
        pairs = zip(self.records, self._index, strict=True)
        return [kernel.run(motion_rows(record), theta[index])[1] for record, index in pairs]

    def speeds(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return for each segment |ν_x| (N,) of the model."""
        return [np.abs(motion.nu[:, 0]) for motion in self.motions(theta)]

    def sigma_and_profile(
        self, misfits: Sequence[np.ndarray], theta: np.ndarray, floor: np.ndarray
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return σ (m,) and its profile (N, m) per segment from `misfits` at θ, for noise that grows with speed."""
        mask = informative_rows(misfits, self.masks, self.z)
        return speed_profile(misfits, mask, self.speeds(theta), floor)

    def sensitivities(
        self, theta: np.ndarray, last: bool = False
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return for each segment r (N, m), ∂r (N, m, p_segment), and the indices of these entries in θ.

        The result is cached for the next call and must not be modified. With `last` it is removed from the cache, and
        the caller can modify it.
        """
        key, (last_key, slopes) = theta.tobytes(), self._slopes
        if last_key != key:
            slopes = self._map_segments(lambda rows, i: (*self.scan.sensitivities(rows, theta[i]), i))
        self._slopes = (None, []) if last else (key, slopes)
        return slopes

    def predictions(self, theta: np.ndarray) -> list[np.ndarray]:
        """Return for each segment h (N, m), even in rows without a measurement. The arrays must not be modified."""
        is_plain = self.difference is Residuals.difference
        kernel = self.scan
        if not is_plain:
            kernel = cached_kernel(self.blocks, self.shape, self.scan.backend, _trace, Residuals.difference)

        def segment_prediction(rows: np.ndarray, index: np.ndarray, z: np.ndarray) -> np.ndarray:
            return z - np.asarray(kernel.run(_fill(rows, self._weights, 1.0), theta[index])[1])

        def work() -> list[np.ndarray]:
            if is_plain and all(mask.all() for mask in self.masks):
                return [z - misfit for z, misfit in zip(self.z, self.misfits(theta), strict=True)]
            return self._map_segments(segment_prediction, self.z)

        return self._cached("predictions", theta, work)

    def _cached(self, label: str, theta: np.ndarray, work: Callable[[], object]) -> Any:
        """Return `work()`, cached by `label` and θ."""
        key = label, theta.tobytes()
        if key not in self._results:
            self._results[key] = work()
            if len(self._results) > CACHED_RESULTS:
                self._results.popitem(last=False)
        return self._results[key]


def _fill(rows: np.ndarray, index: Any, values: np.ndarray | float) -> np.ndarray:
    """Return a read-only copy of `rows` (N, q) with `values` in the columns `index`."""
    filled_rows = rows.copy()
    filled_rows[:, index] = values
    filled_rows.flags.writeable = False
    return filled_rows


def _rows(record: FitRecord, names: Sequence[str], shape: ThetaShape) -> np.ndarray:
    """Return rows (N, q): dt, u, z and W of all sensors, the part of the step if needed, and the battery voltage."""
    readings = [record.sensors[name] for name in names]
    columns = [record.dt_s[:, None], record.u, *(s.z for s in readings), *(s.mask for s in readings)]
    columns += mean_columns(record, shape.means)
    for s, is_needed in zip(readings, shape.sample_fraction, strict=True):
        if is_needed:
            columns.append(
                np.zeros((len(record.dt_s), 1)) if s.sample_fraction is None else s.sample_fraction[:, None]
            )
    for name in shape.clock_means:
        duration_s = record.sensors[name].duration_s
        columns.append(np.ones((len(record.dt_s), 1)) if duration_s is None else duration_s[:, None])
    if shape.has_voltage:
        columns.append(record.sensors[VOLTAGE_KEY].z)
    return np.ascontiguousarray(np.concatenate(columns, axis=1))


def _trace(blocks: FittedBlocks, shape: ThetaShape, backend: str, residual: Callable[..., Any]) -> Scan:
    n, sizes = blocks.model.commands, [s.size for s in blocks.sensors]
    m, names = sum(sizes), blocks.sensors._fields
    free_clock = [name in shape.clocks for name in names]
    at_start = initial_state(blocks, shape)
    first_duration = 1 + n + 2 * m + WEIGHT_COLUMNS * len(shape.means) + sum(shape.sample_fraction)

    def start(theta: np.ndarray) -> SimulationState:
        vehicle, signals = at_start(theta)
        kinds = list(zip(sizes, shape.sample_fraction, free_clock, strict=True))
        past_h = tuple(np.zeros(k if e and not c else 0) for k, e, c in kinds)
        lines = tuple(np.zeros((shape.past_rows if c else 0, k)) for k, _, c in kinds)
        return SimulationState(vehicle, signals, past_h, lines, np.zeros(shape.past_rows))

    def step(
        theta: np.ndarray, state: SimulationState, row: np.ndarray
    ) -> tuple[SimulationState, np.ndarray]:
        tick_blocks = make_row_blocks(blocks, shape, theta, row)
        dt_s, u = row[0], row[1 : 1 + n]
        z, weight = row[1 + n : 1 + n + m], row[1 + n + m : 1 + n + 2 * m]
        mean_weights = shape.mean_weights(names, row[1 + n + 2 * m :])
        fractions = shape.sample_fractions(row[1 + n + 2 * m :])
        durations = row[first_duration:]
        vehicle, motion = tick_blocks.model.step(state.vehicle, u, dt_s, np.zeros(3))
        readings, signals = read_sensors(tick_blocks.sensors, state.signals, motion, dt_s, mean_weights)
        steps_s = with_newest_value(state.steps_s, dt_s)
        residuals, past_h, lines, offset = [], [], [], 0
        for k, sensor in enumerate(tick_blocks.sensors):
            h = newest = readings[k]
            if free_clock[k]:
                offset_s = theta[len(shape.paths) + shape.clocks.index(names[k])]
                age_s = fractions[k] - offset_s
                if names[k] in shape.clock_means:
                    newest = state.lines[k][0] + dt_s * h  # ∫ h dt
                    length_s = durations[shape.clock_means.index(names[k])]
                    h = delayed_average(newest, state.lines[k], steps_s, age_s, length_s)
                else:
                    h = delayed_value(h, state.lines[k], steps_s, age_s, partial(difference, sensor))
            elif shape.sample_fraction[k]:
                h = h + fractions[k] * difference(sensor, state.previous_h[k], h)
            past_h.append(readings[k] if len(state.previous_h[k]) else state.previous_h[k])
            lines.append(with_newest_value(state.lines[k], newest))
            span = slice(offset, offset + sizes[k])
            residuals.append(weight[span] * residual(sensor, z[span], h))
            offset += sizes[k]
        state = SimulationState(vehicle, signals, tuple(past_h), tuple(lines), steps_s)
        return state, np.concatenate(residuals)

    return scan(
        step, start, np.zeros(1 + n + 2 * m + shape.extra_columns), example(blocks, shape), backend=backend
    )
