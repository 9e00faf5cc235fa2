"""Find the possible motions of a vehicle from its equations, even for your own vehicles.

kept    entries of ν that remain after a tick without a command; empty for a kinematic vehicle        (1)
rates   −∂ν̇_i/∂ν_i at rest [1/s], the rate at which a small motion decays                             (2)
slopes  change of (2) by one unit of a parameter, if (2) is linear in it                              (3)
k       −ν̇_i/ν_i² by one unit of a parameter, if this friction grows with the square of ν_i          (4)
E       the effort per ν that balances the drag that is linear in ν                                    (5)
p_min   = p b/(r_max − a), at which the rate r = a + b of (2) is r_max, if b is proportional to 1/p   (6)
"""

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from baqueano.contracts.optional import is_dynamic
from baqueano.contracts.values import Tree
from baqueano.messages.language import mark as N_
from baqueano.parameter import all_parameters
from baqueano.symbolic import value_at_path, with_value
from baqueano.vehicles.drivetrain import Drivetrain
from baqueano.vehicles.state import DynamicVehicle

AXIS_NAMES = (N_("forward"), N_("sideways"), N_("turning"))
SHORT_TIME_S = 1e-6  # a time so short that velocities do not decay
MAX_YAW_RATE_RATIO = 0.5  # largest ratio between the yaw rates of the first and the last command
DRAG_SPEEDS = (5.0, 10.0, 15.0)  # in units of the speed of the dry friction
SMALL_SPEED = 1e-8  # a speed below the range in which friction changes
MIXED_MOTION = np.array([1.0, 0.7, 0.4])  # along all axes: no effect is 0
RATE_TOLERANCE = 0.05  # part of a largest rate
MIN_RATE = 1e-9  # change of a rate [1/s] below which a parameter has no effect on it


def coasting_axes(vehicle: DynamicVehicle) -> tuple[int, ...]:
    """Return the entries of ν that the vehicle keeps without a command: 0 forward, 1 sideways, 2 turning.  (1)"""
    rest_command, axes = np.zeros(vehicle.commands), []
    for i, nu in enumerate(0.1 * np.eye(3)):
        _, motion = vehicle.step(vehicle.init(nu=nu), rest_command, SHORT_TIME_S, np.zeros(3))
        axes += [i] if motion.nu[i] > 0.05 else []
    return tuple(axes)


def decay_rates(vehicle: DynamicVehicle, freedoms: tuple[int, ...] | None = None) -> np.ndarray:
    """Return the decay rates (3,) [1/s] of motions along the `freedoms`; zeros for a vehicle without nu_dot.  (2)
    `freedoms` is the result of `coasting_axes`, if it is already known.
    """
    if not is_dynamic(vehicle):
        return np.zeros(3)
    return _rates(vehicle, coasting_axes(vehicle) if freedoms is None else freedoms)


def damping_derivatives(
    vehicle: DynamicVehicle, fields: Collection[str], freedoms: tuple[int, ...] | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (path with its entry, slope (3,)) of each parameter of the `fields`, "model.…", that damps a motion.  (3)
    `freedoms` is the result of `coasting_axes`, if it is already known.
    """
    freedoms = coasting_axes(vehicle) if freedoms is None else freedoms
    for path, entry_rates in _entry_rates(vehicle, fields, freedoms, SMALL_SPEED):
        first_step, second_step = entry_rates[1] - entry_rates[0], entry_rates[2] - entry_rates[1]
        if np.any(first_step > 1e-6) and np.allclose(first_step, second_step, rtol=1e-3):
            yield path, np.where(first_step > 1e-6, first_step, 0.0)


def quadratic_damping(
    vehicle: DynamicVehicle, fields: Collection[str], freedoms: tuple[int, ...] | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (path with its entry, k (3,)) of each parameter of the `fields`, "model.…", whose friction grows with the
    square of the speed.  (4)  `freedoms` is the result of `coasting_axes`, if it is already known.
    """
    freedoms = coasting_axes(vehicle) if freedoms is None else freedoms
    double_rates = dict(_entry_rates(vehicle, fields, freedoms, 2.0))
    for path, entry_rates in _entry_rates(vehicle, fields, freedoms, 1.0):
        rates = double_rates.get(path, entry_rates)
        k, double_step = entry_rates[1] - entry_rates[0], rates[1] - rates[0]
        if np.any(k > 1e-6) and np.allclose(2.0 * k, double_step, rtol=1e-3):
            yield path, np.where(k > 1e-6, k, 0.0)


def _entry_rates(
    vehicle: DynamicVehicle, fields: Collection[str], freedoms: tuple[int, ...], speed: float
) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Yield (path with its entry, rates (3,) for its values 0, 1 and 2) of each parameter that changes a rate."""
    model = {"model": vehicle}
    for path, p in all_parameters(vehicle, "model") if is_dynamic(vehicle) else ():
        if path not in fields or p.low > 0.0 or p.high < 2.0 or path.startswith("model.drivetrain"):
            continue

        shape = np.shape(value_at_path(model, path))
        for index in np.ndindex(shape) if _changed_axes(model, path, np.ones(shape), speed) else ():
            entry_path = f"{path}[{','.join(map(str, index))}]" if index else path
            axes = _changed_axes(model, entry_path, np.ones(()), speed).intersection(freedoms)
            changed_models = [with_value(model, entry_path, x)["model"] for x in (0.0, 1.0, 2.0)]
            yield entry_path, [_rates(changed_model, tuple(axes), speed) for changed_model in changed_models]


def _changed_axes(model: dict[str, Tree], path: str, ones: np.ndarray, speed: float) -> set[int]:
    """Return the axes along which a parameter at `path` changes ν̇ of a motion along all axes."""
    nu = speed * MIXED_MOTION
    vehicles = [with_value(model, path, x)["model"] for x in (0.0 * ones, ones)]
    at_zero, at_one = (vehicle.nu_dot(nu, np.zeros(vehicle.commands), 0.0) for vehicle in vehicles)
    return {*np.flatnonzero(np.abs(at_one - at_zero) > MIN_RATE * speed).tolist()}


def _rates(vehicle: DynamicVehicle, index: tuple[int, ...], speed: float = SMALL_SPEED) -> np.ndarray:
    """Return −ν̇_i/ν_i (3,) at a speed along each axis of `index`.  (2), (4)"""
    zero_command, fading_rates = np.zeros(vehicle.commands), np.zeros(3)
    for i in index:
        nu = speed * np.eye(3)[i]
        fading_rates[i] = (
            vehicle.nu_dot(-nu, zero_command, 0.0)[i] - vehicle.nu_dot(nu, zero_command, 0.0)[i]
        ) / (2.0 * speed)
    return fading_rates


def sign_speed_paths(vehicle: DynamicVehicle) -> dict[str, str]:
    """Return, for each parameter of dry friction, the path of the speed over which it changes its sign."""
    entries = all_parameters(vehicle, "model")
    return {path: f"{path.rpartition('.')[0]}.{p.sign_speed}" for path, p in entries if p.sign_speed}


def slowing_bounds(
    vehicle: Tree, highs: Mapping[str, float], max_rate: float
) -> dict[str, tuple[float, float]]:
    """Return bounds of parameters, p_min and the upper one of `highs`: no motion decays faster than `max_rate`.  (6)

    Without a decay that is more than RATE_TOLERANCE faster, {}. The speed over which dry friction changes its sign
    takes precedence over a mass.
    """
    if not is_dynamic(vehicle):
        return {}
    model, rates = {"model": vehicle}, decay_rates(vehicle)
    bounds: dict[str, float] = {}
    fields = sign_speed_paths(vehicle).values()
    for i in np.flatnonzero(rates > (1.0 + RATE_TOLERANCE) * max_rate).tolist():
        for path in sorted(highs, key=lambda path: path.partition("[")[0] not in fields):
            p = float(value_at_path(model, path))
            b = 2.0 * (rates[i] - decay_rates(with_value(model, path, 2.0 * p)["model"])[i])
            if b > MIN_RATE and rates[i] - b < max_rate:
                p_min = float(p * b / (max_rate - rates[i] + b))
                bounds[path] = max(p_min, bounds.get(path, p_min))
                break  # one bound is enough
    return {path: (low, highs[path]) for path, low in bounds.items() if low < highs[path]}


def tyre_paths(vehicle: Tree) -> list[str]:
    """Return the paths of the parameters with the role "tyre"."""
    return [path for path, p in all_parameters(vehicle, "model") if p.role == "tyre"]


def dry_friction_speeds(vehicle: DynamicVehicle) -> np.ndarray:
    """Return the speed (3,) over which the dry friction along each axis changes its sign; infinite without friction.

    A parameter of friction without an entry for each axis acts along the first one.
    """
    model, speeds, definitions = (
        {"model": vehicle},
        np.full(3, np.inf),
        dict(all_parameters(vehicle, "model")),
    )
    for path, speed_path in sign_speed_paths(vehicle).items():
        is_dry, speed = value_at_path(model, path) > 0.0, value_at_path(model, speed_path)
        axes = is_dry if definitions[path].axes else np.any(is_dry) & (np.arange(3) == 0)
        speeds = np.where(axes, speed, speeds)
    return speeds


def linear_drag_efforts(vehicle: Tree) -> np.ndarray:
    """Return E (n, 3): E ν balances the part of the drag that is linear in ν, of each dynamic vehicle.  (5)"""
    n = vehicle.commands
    if not is_dynamic(vehicle):
        return np.zeros((n, 3))
    still, units = np.zeros(n), np.minimum(dry_friction_speeds(vehicle), 1.0)
    drag = [-np.diagonal([vehicle.nu_dot(k * nu, still, 0.0) for nu in np.diag(units)]) for k in DRAG_SPEEDS]
    linear = np.array([-2.5, 4.0, -1.5]) @ drag / (DRAG_SPEEDS[0] * units)
    gains = [vehicle.nu_dot(np.zeros(3), u, 0.0) - vehicle.nu_dot(np.zeros(3), still, 0.0) for u in np.eye(n)]
    return np.linalg.pinv(np.array(gains).T) * linear


def with_ideal_drivetrain(vehicle: DynamicVehicle) -> DynamicVehicle:
    """Return the vehicle with an ideal drivetrain, without a dead zone that hides the effect of small commands."""
    mixing, servos = vehicle.drivetrain.mixing, vehicle.drivetrain.servos
    drivetrain = Drivetrain(mixing=mixing, commands=vehicle.commands, servos=servos)
    return with_value({"model": vehicle}, "model.drivetrain", drivetrain)["model"]


def is_steered(vehicle: DynamicVehicle) -> bool:
    """Return True if the last command turns the vehicle only while it moves, as a servo does."""
    return vehicle.commands > 1 and not np.any(_accelerations(vehicle, -1))


def is_turned_by_last_command(vehicle: DynamicVehicle) -> bool:
    """Return True if the last command turns the vehicle: as a servo, or over twice as fast as the first command."""
    return is_steered(vehicle) or bool(
        abs(_accelerations(vehicle, 0)[2]) < MAX_YAW_RATE_RATIO * abs(_accelerations(vehicle, -1)[2])
    )


def _accelerations(vehicle: DynamicVehicle, command: int) -> np.ndarray:
    """Return ν (3,) shortly after rest, with one unit of one command; this ν is proportional to the acceleration."""
    vehicle, u = with_ideal_drivetrain(vehicle), np.eye(vehicle.commands)[command]
    state, _ = vehicle.step(vehicle.init(), u, SHORT_TIME_S, np.zeros(3))
    return vehicle.step(state, u, SHORT_TIME_S, np.zeros(3))[0].nu
