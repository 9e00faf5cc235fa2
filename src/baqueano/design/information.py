"""Compute the Fisher information of a drive about the parameters, exactly, before the drive.

    F = Σ_k Hᵀ Q⁻¹ H,   H_k = ∂h(x_k)/∂(θ, b, ν₀)      along the simulation                               (1)
    S = F_θθ − F_θn F_nn⁻¹ F_nθ                         information about θ with n unknown                (2)
    J = mean over some possible vehicles of log det(D S D + P₀)                                           (3)

θ contains the parameters that are free in a default fit and have an effect in this vehicle. n is the nuisance, which
a fit also estimates. It contains the biases of the sensors, the velocity at the start, and free parameters that are 0
in the file. D = diag(size of each parameter), so that S refers to relative errors. P₀ = 1 is a prior of 100 % of that
size. With it, parameters that a drive does not show do not dominate (3) (a Bayesian D-optimal design; Chaloner and
Verdinelli 1995). F is for white sensor noise, without process noise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import Tree
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import (
    FreeParameter,
    default_free,
    entries,
    fixed_columns,
    free_parameter,
    substitute,
    value,
)
from baqueano.symbolic import scan
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicles.freedoms import coasting_axes
from baqueano.worlds.simulated import step_vehicle, tick_row_count

BIASES = ("accel_bias", "gyro_bias")
NUISANCE_STD = 0.3  # m/s², rad/s, m/s: prior standard deviation of a bias or an initial velocity


class Unknowns(NamedTuple):
    """Parameters θ and nuisance of (1)."""

    paths: tuple[str, ...]  # (q,) the parameters of interest are first
    interest_count: int  # number of paths of interest
    start_axes: tuple[int, ...]  # entries of ν₀, after the paths
    size: np.ndarray  # (q + starts,) size of each: magnitude of its value, or prior standard deviation

    @property
    def names(self) -> tuple[str, ...]:
        """Return the paths of the parameters of interest."""
        return self.paths[: self.interest_count]


def unknowns(vehicle_file: VehicleFile) -> Unknowns:
    """Return the parameters and the nuisance that a fit of a forward drive of this vehicle estimates."""
    blocks = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors)
    candidates = [free_parameter(blocks, p, {}) for p in default_free(blocks)]
    constant = fixed_columns(candidates, np.asarray(vehicle_file.command.limit)[None])
    free_paths = [parameter.path for k, parameter in enumerate(candidates) if k not in constant]
    interest_paths = [p for p in free_paths if value(blocks, p) != 0.0]
    zero_paths = [p for p in free_paths if p not in interest_paths]
    pairs = [(name, field) for name in blocks.sensors._fields for field in BIASES]
    fields = [f"sensors.{n}.{field}" for n, field in pairs if has_field(getattr(blocks.sensors, n), field)]
    bias_paths, start_axes = [p for f in fields for p in entries(blocks, f)], coasting_axes(blocks.model)
    size = [abs(value(blocks, p)) for p in interest_paths]
    size += [_parameter_scale(blocks, p, candidates) for p in zero_paths]
    size += [NUISANCE_STD] * (len(bias_paths) + len(start_axes))
    paths = (*interest_paths, *zero_paths, *bias_paths)
    return Unknowns(paths, len(interest_paths), start_axes, np.array(size))


class DriveInformation:
    """Fisher information F of drives of one vehicle file."""

    def __init__(self, vehicle_file: VehicleFile, backend: str = "auto") -> None:
        self.unknowns = unknowns(vehicle_file)
        free_parameters, rate_hz = self.unknowns, vehicle_file.rate_hz
        blocks = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors)
        n, no_noise = blocks.model.commands, np.zeros((tick_row_count(1.0 / rate_hz), 3))
        var = np.concatenate([np.diag(s.cov) for s in blocks.sensors])
        weight = 1.0 / np.sqrt(np.where(var > 0.0, var, 1.0))

        def start(theta: np.ndarray) -> Tree:
            nu = np.zeros(3)
            for k, i in enumerate(free_parameters.start_axes):
                nu = nu + theta[len(free_parameters.paths) + k] * np.eye(3)[i]
            return substitute(blocks, free_parameters.paths, theta).model.init(nu=nu)

        def step(theta: np.ndarray, state: Tree, u: np.ndarray) -> tuple[Tree, np.ndarray]:
            tick_blocks = substitute(blocks, free_parameters.paths, theta)
            state, motion = step_vehicle(tick_blocks.model, state, u, 1.0 / rate_hz, no_noise)
            return state, weight * np.concatenate([s.h(motion) for s in tick_blocks.sensors])

        self.start, self.tick, self.commands = start, step, n
        self.nominal = np.array(
            [*(value(blocks, p) for p in free_parameters.paths), *np.zeros(len(free_parameters.start_axes))]
        )
        self.kernel = scan(step, start, np.zeros(n), self.nominal, backend=backend)

    def theta(self, paths: Sequence[str], values: np.ndarray) -> np.ndarray:
        """Return the nominal θ (q,) with `values` (p,) in the entries `paths`. Paths that θ does not contain are
        ignored."""
        theta = self.nominal.copy()
        for path, x in zip(paths, values, strict=True):
            if path in self.unknowns.paths:
                theta[self.unknowns.paths.index(path)] = x
        return theta

    def information(self, u: np.ndarray, theta: np.ndarray | None = None) -> np.ndarray:
        """Return D F D (q, q) of the drive with the commands `u` (N, n), at `theta` or at the nominal θ.  (1)"""
        F = self.kernel.normal_equations(u, self.nominal if theta is None else theta).hessian
        return F * np.outer(self.unknowns.size, self.unknowns.size)

    def relative_std(self, F: np.ndarray) -> np.ndarray:
        """Return the relative standard error (p,) of each parameter of interest. It is at most 1, the prior."""
        return np.sqrt(np.diagonal(np.linalg.inv(F + np.eye(len(F))))[: self.unknowns.interest_count])


def mean_error(relative_std: np.ndarray) -> float:
    """Return the geometric mean of the relative standard errors."""
    return float(np.exp(np.mean(np.log(relative_std))))


def _parameter_scale(blocks: FittedBlocks, path: str, candidates: Sequence[FreeParameter]) -> float:
    """Return the size of a parameter that is 0: the largest value in its matrix row, or among the frictions of its axis
    (at 1 m/s or 1 rad/s). If this is 0, return the largest value of its field, or 1 if that is also 0."""
    parameter = free_parameter(blocks, path, {})
    is_gain = parameter.definition.role == "gain"
    same_axis = [entry for entry in candidates if parameter.axis is not None and entry.axis == parameter.axis]
    kind_entries = [entry for entry in same_axis if (entry.definition.role == "gain") == is_gain]
    row_sizes = [abs(value(blocks, entry.path)) for entry in kind_entries]
    matrix_sizes = [abs(value(blocks, p)) for p in entries(blocks, path.partition("[")[0])]
    return max(row_sizes, default=0.0) or max(matrix_sizes) or 1.0
