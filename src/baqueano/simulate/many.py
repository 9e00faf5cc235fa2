"""Simulate thousands of vehicles with the same signal and different parameters, in parallel in one kernel.

  x_{k+1} = step(vehicle(θ_l), x_k, u_k, δ, noise_k),   l = 1 … L                                       (1)

Every θ_l is drawn from the covariance of the file's fit, or given by the user. Pose and velocity are stored every
`every_s`. The vehicles run in batches, so that their noise fits into memory. The kernel uses all processors.
"""

from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow, Tree
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.errors import UsageError
from baqueano.messages import verdict_line
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.parameter import parameters
from baqueano.signals import seconds
from baqueano.simulate.open_loop import command_signal, tick_times
from baqueano.simulate.system import System, parameter_labels, parameter_vector, value_at, with_parameters
from baqueano.symbolic import scan, value_at_path
from baqueano.symbolic.function import KernelKey
from baqueano.symbolic.scan import Scan
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicle_file.envelope import EnvelopeMonitor
from baqueano.vehicles import VehicleState
from baqueano.worlds.noise import random_stream
from baqueano.worlds.simulated import step_vehicle, tick_row_count

CHUNK_VEHICLES = 2**15  # largest number of vehicles in a batch
MAX_NOISE_BYTES = 2**26  # of standard normals that are stored at a time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Ensemble(Result):
    """The simulated motion of L vehicles at K times.

    Attributes
    ----------
    names : tuple of str
        Dotted keys of the p parameters that vary.
    theta : ndarray (L, p)
        Values of these parameters for each vehicle [unit of each].
    t_s : ndarray (K,)
        Times of the stored poses.
    eta : ndarray (L, K, 3) [m, m, rad]
        Poses in the map.
    nu : ndarray (L, K, 3) [m/s, m/s, rad/s]
        Velocities in the body frame.
    clipped_draws : int
        Number of vehicles with a drawn parameter that was set to its bound.
    backend : str
        Back end of the kernel.
    envelope_warnings : tuple of Diagnostic
        Commands outside the envelope of the fit.

    Examples
    --------
    >>> swarm = simulate_many(bq.load("small"), np.tile([0.5, 0.0, 0.0], (50, 1)), vary={"model.mass_kg": [0.5, 0.6]})
    >>> swarm.eta.shape[0], swarm.names
    (2, ('model.mass_kg',))
    """

    names: tuple[str, ...]
    theta: np.ndarray
    t_s: np.ndarray
    eta: np.ndarray
    nu: np.ndarray
    clipped_draws: int
    backend: str
    envelope_warnings: tuple[Diagnostic, ...] = ()

    def rows(self) -> list[TableRow]:
        """Return a row for each time: mean and standard deviation over the vehicles whose states are finite.

        Headings are averaged as angles.
        """
        finite_motion = self.eta[self._is_finite], self.nu[self._is_finite]
        columns = ("x_m", "y_m", "psi_rad", "nu_x_m_s", "nu_y_m_s", "nu_psi_rad_s")
        rows = []
        for k, t_s in enumerate(self.t_s):
            motion = np.concatenate([finite_motion[0][:, k], finite_motion[1][:, k]], axis=1)
            psi = motion[:, 2]
            mean = motion.mean(axis=0)
            mean[2] = np.arctan2(np.mean(np.sin(psi)), np.mean(np.cos(psi)))
            std = motion.std(axis=0)
            std[2] = np.std(np.angle(np.exp(1j * (psi - mean[2]))))
            row: TableRow = {"t_s": float(t_s), "vehicles": len(motion)}
            for name, m, s in zip(columns, mean, std, strict=True):
                row |= {name: float(m), f"{name}_std": float(s)}
            rows.append(row)
        return rows

    def table(self) -> str:
        """Return a text with the rows as a table."""
        rows = []
        for row in self.rows():
            row = {key: number(value) for key, value in row.items()}
            psi, psi_std = (number(float(np.degrees(row[key]))) for key in ("psi_rad", "psi_rad_std"))
            positions = [f"{row[name]:.3f} ± {row[f'{name}_std']:.3f}" for name in ("x_m", "y_m")]
            speed = f"{row['nu_x_m_s']:.3f} ± {row['nu_x_m_s_std']:.3f}"
            rows.append([f"{row['t_s']:.2f}", *positions, f"{psi:.1f} ± {psi_std:.1f}", speed])
        lines = [
            _(
                "{vehicles} vehicles, varied: {names}",
                vehicles=len(self.theta),
                names=", ".join(self.names) or _("noise alone"),
            ),
            *text_table(">>>>>", ["t [s]", "x [m]", "y [m]", _("heading [°]"), _("speed [m/s]")], *rows),
        ]
        return "\n".join([*lines, "", verdict_line(self.verdict, self.reasons)])

    @property
    def verdict(self) -> Verdict:
        """Return WARN if `reasons` is not empty, else DONE."""
        return Verdict.WARN if self.reasons else Verdict.DONE

    @property
    def reasons(self) -> tuple[Diagnostic | str, ...]:
        """Return warnings: commands outside the envelope, diverged vehicles, and clipped parameters."""
        lost_count, vehicles = int(np.sum(~self._is_finite)), len(self.theta)
        messages: list[Diagnostic | str] = list(self.envelope_warnings)
        if lost_count:
            messages.append(note("simulate.lost", Severity.WARNING, count=lost_count, vehicles=vehicles))
        if self.clipped_draws:
            messages.append(
                note("simulate.clipped", Severity.WARNING, count=self.clipped_draws, vehicles=vehicles)
            )
        return tuple(messages)

    @property
    def _is_finite(self) -> np.ndarray:
        return np.all(np.isfinite(self.eta) & np.isfinite(self.nu), axis=(1, 2))


def simulate_many(
    vehicle_file: VehicleFile,
    u: ArrayLike,
    vehicles: int | None = None,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    seed: int = 0,
    process_noise: bool = False,
    every_s: float | None = None,
    eta0: np.ndarray | None = None,
    backend: str = "auto",
) -> Ensemble:
    """Simulate many vehicles under the same commands, each with other parameters.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle.
    u : array_like (N, n) [unit of the file's [command]]
        The commands, one per tick.
    vehicles : int, optional
        Number of draws from the covariance of the file's fit, if `vary` is not given.
    vary : dict of array_like, optional
        Values by dotted key: {"model.mass_kg": (L,), "model.friction.linear": (L, 3)}.
    seed : int
        Seed of the draws and of the noise.
    process_noise : bool
        True: each vehicle has separate process noise.
    every_s : float, optional
        Period at which poses and velocities are stored; by default only at the end.
    eta0 : ndarray (3,), optional [m, m, rad]
        Pose at the start in the map; the vehicles begin at rest.
    backend : str
        "auto", "c", "python" or "numpy".

    Returns
    -------
    Ensemble
        Poses and velocities.

    Raises
    ------
    UsageError
        For an input that `simulate` rejects, a wrong number of values in `vary`, or a file without a covariance.

    Notes
    -----
    Equation (1) of the module.

    Examples
    --------
    >>> from baqueano.vehicle_file import load
    >>> u, mass = np.tile([0.6, 0.0, 0.0], (20, 1)), {"model.mass_kg": np.linspace(0.5, 0.7, 50)}
    >>> many = simulate_many(load("small"), u, vary=mass)
    >>> print(many.nu.shape, f"{np.ptp(many.nu[:, -1, 0]):.3f} m/s apart")
    (50, 1, 3) 0.022 m/s apart
    """
    u = command_signal(vehicle_file, u)
    rate = vehicle_file.rate_hz
    rows_per_tick = tick_row_count(1.0 / rate)
    system = System(vehicle_file.vehicle, vehicle_file.sensors)
    if vary is None:
        paths, theta, clips = draw_parameters(vehicle_file, system, vehicles, seed)
    else:
        (paths, theta), clips = parameter_sets(system, vary, vehicles), 0
    ticks_per_record = len(u) if every_s is None else max(1, round(every_s * rate))
    record_ends = sorted({*range(ticks_per_record, len(u) + 1, ticks_per_record), len(u)})
    kernel = batch_kernel(system, paths, rate, process_noise, backend)
    start = system.model.init(None if eta0 is None else np.array(eta0, dtype=float))
    batches = []
    longest_rows = rows_per_tick * int(np.max(np.diff([0, *record_ends])))
    for rows in _chunks(len(theta), process_noise, longest_rows):
        rngs = (
            [random_stream(seed, f"vehicle.{l}") for l in range(rows.start, rows.stop)]
            if process_noise
            else []
        )
        batches.append(_drive(kernel, start, u, theta[rows], record_ends, rngs, rows_per_tick))
    eta, nu = (np.concatenate(x) for x in zip(*batches, strict=True))
    t_s = seconds(tick_times(len(u), rate)[np.array(record_ends) - 1])
    watch = EnvelopeMonitor(vehicle_file.envelope)
    watch.count(u, {})
    envelope_flags = watch.range_warnings(note("envelope.this-signal"))
    return Ensemble(
        tuple(parameter_labels(system, paths)), theta, t_s, eta, nu, clips, kernel.backend, envelope_flags
    )


def batch_kernel(
    system: System, paths: tuple[str, ...], rate_hz: float, process_noise: bool, backend: str
) -> Scan:
    """Return the scan (1): from θ, VehicleState and (u, noise) to the next VehicleState, in the rows of a tick."""
    return _batch_kernel(KernelKey(system), paths, rate_hz, process_noise, backend)


@lru_cache(maxsize=16)
def _batch_kernel(
    key: KernelKey, paths: tuple[str, ...], rate_hz: float, process_noise: bool, backend: str
) -> Scan:
    (system,) = key.parts
    no_noise = np.zeros((tick_row_count(1.0 / rate_hz), 3))

    def step(theta: Tree, state: VehicleState, x: Tree) -> tuple[VehicleState, Tree]:
        u, noise = x
        model = with_parameters(system, paths, theta).model
        state, _ = step_vehicle(model, state, u, 1.0 / rate_hz, no_noise if noise is None else noise)
        return state, state.eta

    example = (np.zeros(system.model.commands), no_noise if process_noise else None)
    return scan(step, system.model.init(), example, parameter_vector(system, paths), backend=backend)


def parameter_sets(
    system: System, vary: Mapping[str, ArrayLike], vehicles: int | None
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the paths and θ (L, p) of `vary`. Raise UsageError for a wrong shape or count, or for NaN or infinity."""
    columns, count = [], vehicles
    for path, values in vary.items():
        shape = value_at(system, path).shape
        array = np.array(values, dtype=float)
        if array.shape[1:] != shape or array.ndim != len(shape) + 1:
            expected_shape = "(L" + "".join(f", {n}" for n in shape) + ("," if not shape else "") + ")"
            raise UsageError.of(
                "simulate.vary-shape", path=path, value=str(array.shape), expected=expected_shape
            )
        if count is not None and len(array) != count:
            raise UsageError.of("simulate.vary-count", path=path, value=len(array), expected=count)
        if not np.all(np.isfinite(array)):
            raise UsageError.of("simulate.vary-not-finite", path=path)
        count = len(array)
        columns.append(array.reshape(count, -1))
    if not count:
        raise UsageError.of("simulate.no-vehicles")
    return tuple(vary), np.concatenate(columns, axis=1) if columns else np.zeros((count, 0))


def draw_parameters(
    vehicle_file: VehicleFile, system: System, vehicles: int | None, seed: int
) -> tuple[tuple[str, ...], np.ndarray, int]:
    """Return the paths, θ (L, p) drawn from the covariance of the fit, and the number of clipped vehicles.
    Raise UsageError for a file without a covariance of the model, or for a number of vehicles below 1.
    """
    fit = vehicle_file.parameter_cov
    model_indices = (
        [] if fit is None else [k for k, name in enumerate(fit.names) if name.startswith("model.")]
    )
    if fit is None or not model_indices:
        raise UsageError.of(
            "simulate.no-covariance", "baqueano identify last --update", name=vehicle_file.name
        )
    if not vehicles or vehicles < 1:
        raise UsageError.of("simulate.vehicles", vehicles=vehicles)
    paths = tuple(fit.names[k] for k in model_indices)
    mean = parameter_vector(system, paths)
    variances, axes = np.linalg.eigh(fit.cov[np.ix_(model_indices, model_indices)])
    normals = random_stream(seed, "parameters").standard_normal((vehicles, len(model_indices)))
    theta = mean + (normals * np.sqrt(np.maximum(variances, 0.0))) @ axes.T
    low, high = np.array([parameter_bounds(system, path) for path in paths]).T
    clipped_theta = np.clip(theta, low, high)
    return paths, clipped_theta, int(np.sum(np.any(clipped_theta != theta, axis=1)))


def parameter_bounds(system: System, path: str) -> tuple[float, float]:
    """Return the allowed range (low, high) of the parameter at `path`; (−∞, ∞) if the field does not have bounds."""
    parent, _, name = path.rpartition(".")
    block = value_at_path(system, parent)
    field = dict(parameters(block)).get(name.partition("[")[0]) if is_dataclass(block) else None
    return (field.low, field.high) if field is not None else (-np.inf, np.inf)


def _chunks(vehicle_count: int, process_noise: bool, row_count: int) -> list[slice]:
    """Return the rows of θ for each call of the kernel, so few that their noise fits into memory."""
    chunk_size = (
        max(8, min(CHUNK_VEHICLES, MAX_NOISE_BYTES // (24 * row_count))) if process_noise else CHUNK_VEHICLES
    )
    return [slice(i, min(i + chunk_size, vehicle_count)) for i in range(0, vehicle_count, chunk_size)]


def _drive(
    kernel: Scan,
    start: Tree,
    u: np.ndarray,
    theta: np.ndarray,
    record_ends: list[int],
    rngs: "list[np.random.Generator]",
    rows_per_tick: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses and the velocities (l, K, 3) of a batch of l vehicles after the ticks `record_ends`."""
    eta, nu, state, begin = [], [], start, 0
    for end in record_ends:
        draws = [rng.standard_normal((end - begin, rows_per_tick, 3)) for rng in rngs]
        noise = np.stack(draws) if draws else None
        state, _ = kernel.batch((u[begin:end], noise), theta, carry=state)
        eta.append(state.eta)
        nu.append(state.nu)
        begin = end
    return np.stack(eta, axis=1), np.stack(nu, axis=1)
