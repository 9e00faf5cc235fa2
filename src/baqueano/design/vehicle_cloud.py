"""Draw the vehicles that a plan considers possible, and simulate them together with the same commands.

    θ_l = θ̂ exp(s n_l)     without a fit s = 0.2 by default; not determined by a fit: MAX_RELATIVE_STD     (1)
    θ_l = θ̂ + P^½ n_l               parameters of the last fit, P their covariance                        (2)
    x_{k+1} = step(vehicle(θ_l), x_k, u_k, δ, noise_lk)                                                   (3)
    P ← P − P_·W (P_WW + S)⁻¹ P_W·   W: entries with too large an error,   θ_l ← θ_l + P_·B P_BB⁻¹ (b − θ_lB)  (4)

A standard error above MAX_RELATIVE_STD of the value is reduced to that, as if a data sheet gave it with variance S.
Entries B of a draw beyond their bounds b are moved to the bounds. Both updates also change the parameters that are
correlated with these entries. Otherwise, some vehicles would not have friction and would never stop. The n_l come in
pairs ± n, so that the draw does not move the mean. A parameter that is 0 in the file stays 0 in (1). All vehicles are
simulated in one call of one kernel; several candidates for the next primitive are distributed over the cores.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from baqueano.diagnostics import Verdict
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import default_free, value
from baqueano.identify.result.fit_result import Fit
from baqueano.numerics.parallel import parallel_map
from baqueano.numerics.statistics import QUANTILE_95
from baqueano.simulate.many import batch_kernel, parameter_bounds
from baqueano.simulate.system import System
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicles import VehicleState
from baqueano.vehicles.freedoms import damping_derivatives
from baqueano.worlds.noise import random_stream, unit_normals
from baqueano.worlds.simulated import tick_row_count

RELATIVE_STD = 0.2  # relative standard deviation of a parameter without a fit
SIDEWAYS = 1  # entry of ν
MAX_RELATIVE_STD = 0.5  # largest standard deviation of a parameter, relative to its value
VEHICLES = 48  # possible vehicles: the error of their standard deviation is 10 %
NOISE_S = 64.0  # duration of the noise that is drawn at once, longer if requested
STIFFNESS_TEST_S = 0.5  # duration of each command
MAX_SPEED_M_S = 100.0  # a faster vehicle is an error of the integrator
CACHED_WINDOWS = 16  # spans of the noise that are cached, in the memory layout of the kernel


@dataclass(frozen=True, slots=True, eq=False)
class VehicleDistribution:
    """Possible vehicles: the nominal one first, then the others."""

    paths: tuple[str, ...]  # (p,) the uncertain parameters, with the index of an entry
    theta: np.ndarray  # (L, p)

    def subset(self, vehicle_count: int) -> "VehicleDistribution":
        """Return the nominal vehicle and at most `vehicle_count` of the others, in pairs ± n."""
        half_count = (len(self.theta) - 1) // 2
        pair_count = min(vehicle_count // 2, half_count)
        pairs = np.arange(1, 1 + pair_count)
        return VehicleDistribution(self.paths, self.theta[np.r_[0, pairs, half_count + pairs]])


def possible_vehicles(
    vehicle_file: VehicleFile,
    relative_std: float = RELATIVE_STD,
    vehicle_count: int = VEHICLES,
    seed: int = 0,
) -> VehicleDistribution:
    """Return the nominal vehicle and `vehicle_count` vehicles that are possible according to the file.  (1), (2)"""
    blocks, fit = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors), vehicle_file.parameter_cov
    fit_indices = [] if fit is None else [k for k, n in enumerate(fit.names) if n.startswith("model.")]
    names = [] if fit is None else [fit.names[k] for k in fit_indices]
    free_paths = [p for p in default_free(blocks) if p.startswith("model.")]
    guesses = [p for p in free_paths if p not in names and value(blocks, p) != 0.0]
    paths = (*names, *guesses)
    mean = np.array([value(blocks, p) for p in paths])
    half_draws = random_stream(seed, "possible_vehicles").standard_normal((vehicle_count // 2, len(paths)))
    unit_draws = np.concatenate([np.zeros((1, len(paths))), half_draws, -half_draws])
    # a fit that does not determine a parameter leaves it as uncertain as a parameter with the largest error
    guess_std = relative_std if fit is None else max(relative_std, MAX_RELATIVE_STD)
    theta = mean * np.exp(guess_std * unit_draws)
    system = System(vehicle_file.vehicle, vehicle_file.sensors)
    low, high = np.array([parameter_bounds(system, p) for p in paths]).T
    if fit is not None and names:
        k, cov = len(names), fit.cov[np.ix_(fit_indices, fit_indices)]
        theta[:, :k] = _draw_parameters(unit_draws[:, :k], mean[:k], cov, low[:k], high[:k])
    return VehicleDistribution(paths, np.clip(theta, low, high))


def _draw_parameters(
    unit: np.ndarray, mean: np.ndarray, cov: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return θ (L, p) from standard normal draws (L, p), between bounds (p,).  (2), (4)"""
    std = np.sqrt(np.maximum(np.diagonal(cov), 1e-300))
    P, ratio = cov / np.outer(std, std), MAX_RELATIVE_STD * np.abs(mean) / std
    is_reduced = ratio < 1.0
    prior_cov = np.diag(ratio[is_reduced] ** 2 / (1.0 - ratio[is_reduced] ** 2))
    gain = np.linalg.pinv(P[np.ix_(is_reduced, is_reduced)] + prior_cov, hermitian=True)
    P = P - P[:, is_reduced] @ gain @ P[is_reduced]
    eigenvalues, axes = np.linalg.eigh(P)
    draws, low = (unit * np.sqrt(np.maximum(eigenvalues, 0.0))) @ axes.T, (low - mean) / std
    high = (high - mean) / std
    return mean + std * np.array([_move_inside(low, high, draw, P) for draw in draws])


def _move_inside(low: np.ndarray, high: np.ndarray, x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return a draw x (p,) with covariance P (p, p), moved between its bounds.  (4)"""
    draw, is_fixed = x, np.zeros(len(x), bool)
    while (is_outside := ~is_fixed & ((draw < low) | (draw > high))).any():
        is_fixed |= is_outside
        correction = np.clip(x, low, high)[is_fixed] - x[is_fixed]
        draw = x + P[:, is_fixed] @ np.linalg.pinv(P[np.ix_(is_fixed, is_fixed)], hermitian=True) @ correction
    return draw


def planning_file(fit: Fit, rough_file: VehicleFile) -> VehicleFile:
    """Return the file for the next plan: the file of a `fit`, or the `rough_file` of a refused fit. The plan takes
    frictions that the fit does not determine as uncertain guesses. If the fit does not show how the vehicle stops
    sideways, the sideways friction comes from the rough file."""
    return rough_file if fit.verdict == Verdict.REFUSED else _with_sideways_friction(fit, rough_file)


def _with_sideways_friction(fit: Fit, rough_file: VehicleFile) -> VehicleFile:
    """Return the file of the fit, with the sideways friction of the `rough_file` if each entry of it may be 0. Pulses
    on one spot give little information on it, and without it a vehicle would slide without end."""
    file, cov = fit.vehicle_file, fit.vehicle_file.parameter_cov
    slopes = damping_derivatives(fit.blocks.model, _fields(fit))
    paths = [path for path, slope in slopes if slope[SIDEWAYS] > 0.0]
    is_shown = [
        x > QUANTILE_95 * std
        for name, x, std in zip(fit.names, fit.estimate, fit.std, strict=True)
        if name in paths
    ]
    if not is_shown or any(is_shown) or cov is None:
        return file
    values: dict[str, list[float]] = {}
    for path in paths:
        field, _, entry = path.partition("[")
        number = np.array(values.get(field, file.value(field)), dtype=float)
        index = tuple(map(int, filter(None, entry.rstrip("]").split(","))))
        number[index] = np.asarray(rough_file.value(field), dtype=float)[index]
        values[field] = number.tolist()
    kept_indices = [k for k, name in enumerate(cov.names) if name not in paths]
    names = tuple(cov.names[k] for k in kept_indices)
    return file.with_values(
        values, None, cov._replace(names=names, cov=cov.cov[np.ix_(kept_indices, kept_indices)])
    )


def _fields(fit: Fit) -> set[str]:
    return {name.partition("[")[0] for name in fit.names}


class VehicleCloud:
    """Simulation of L possible vehicles with the same commands."""

    def __init__(
        self,
        vehicle_file: VehicleFile,
        distribution: VehicleDistribution,
        seed: int = 0,
        backend: str = "auto",
    ) -> None:
        self.distribution, self.seed, self.rate_hz = distribution, seed, vehicle_file.rate_hz
        system = System(vehicle_file.vehicle, vehicle_file.sensors)
        self.kernel = batch_kernel(
            system, distribution.paths, self.rate_hz, process_noise=True, backend=backend
        )
        self.rest_state = system.model.init()
        self.size = len(distribution.theta)
        self.has_noise = bool(np.any(getattr(vehicle_file.vehicle, "process_noise_std", 1.0)))
        self._draw = np.zeros((self.size, 0, tick_row_count(1.0 / self.rate_hz), 3))
        self._windows: dict[tuple[int, int], np.ndarray] = {}
        self._reduce_stiffness(np.asarray(vehicle_file.command.limit, dtype=float))

    def state_at(self, pose: Any) -> VehicleState:
        """Return the states of all vehicles (L, …), at rest at the pose (3,)."""
        pose = np.tile(np.array(pose, dtype=float), (self.size, 1))
        drivetrain_leaves = (
            np.repeat(np.asarray(x, dtype=float)[None], self.size, axis=0) for x in self.rest_state.drivetrain
        )
        nu, nu_dot = (np.tile(x, (self.size, 1)) for x in (self.rest_state.nu, self.rest_state.nu_dot))
        return VehicleState(pose, nu, nu_dot, type(self.rest_state.drivetrain)(*drivetrain_leaves))

    def drive(self, state: VehicleState, u: np.ndarray, tick: int = 0) -> tuple[VehicleState, np.ndarray]:
        """Return the states (L, …) of the vehicles after the commands `u` (T, n), and their poses (L, T, 3). `tick` is
        the first tick of the noise. (3)"""
        noise = self._noise(tick, len(u))
        return self.kernel.batch((u, noise), self.distribution.theta, carry=state, with_outputs=True)

    def drive_each(
        self, states: Sequence[VehicleState], commands: Sequence[np.ndarray], tick: int = 0
    ) -> list[tuple[VehicleState, np.ndarray]]:
        """Return the result of `drive` for each pair of state and commands, computed on all cores. All use the noise
        from `tick` on."""
        return parallel_map(
            lambda x, u: self.drive(x, u, tick), states, commands, rows=self.size * sum(map(len, commands))
        )

    def _reduce_stiffness(self, limit: np.ndarray) -> None:
        """Move draws that are too stiff for the integrator towards the nominal vehicle, at most 8 times.

        Such draws have a very high friction: a fit with little information on friction does not limit the friction.
        Each combination of full commands and zero is tested, because the stiffness depends on the motion.
        """
        levels = [(-x, 0.0, x) if x > 0.0 else (0.0,) for x in np.where(np.isfinite(limit), limit, 1.0)]
        commands = np.repeat(list(product(*levels)), round(STIFFNESS_TEST_S * self.rate_hz), axis=0)
        max_distance_m = MAX_SPEED_M_S * len(commands) / self.rate_hz
        for _ in range(8):
            with np.errstate(all="ignore"):
                _, eta = self.drive(self.state_at(np.zeros(3)), commands)
                has_diverged = ~(np.abs(eta) < max_distance_m).all(axis=(1, 2))
            if not has_diverged.any():
                break
            theta = self.distribution.theta.copy()
            theta[has_diverged] = 0.5 * (theta[0] + theta[has_diverged])
            self.distribution = VehicleDistribution(self.distribution.paths, theta)

    def _noise(self, tick: int, ticks: int) -> np.ndarray:
        """Return standard normal noise (L, T, r, 3) for T ticks of r rows; it is 0 for the nominal vehicle. A tick has
        the same noise in every call."""
        draws = self._draw
        if draws.shape[1] < tick + ticks:
            drawn_ticks = max(2 * draws.shape[1], tick + ticks, round(NOISE_S * self.rate_hz))
            draws = self._draw = np.zeros((self.size, drawn_ticks, *draws.shape[2:]))
            if self.has_noise:
                normals = unit_normals(self.seed, "cloud", drawn_ticks, draws[1:, 0].size)
                draws[1:] = normals.reshape(drawn_ticks, *draws[1:, 0].shape).swapaxes(0, 1)
        key, windows = (tick, ticks), self._windows
        if key not in windows:
            if len(windows) >= CACHED_WINDOWS:
                windows = self._windows = {}
            windows[key] = np.ascontiguousarray(draws[:, tick : tick + ticks])
        return windows[key]
