"""Compute the gains of the heading hold for the vehicle of a file.

  model (2) of controllers/heading_hold.py     k, τ by a difference of one tick, at half the forward limit
                                               T = delay + lag of the motors that turn it + 1.5 ticks + LINK_DELAY_S

If the turn response at half the limit is too small, as in a dead zone, the full limit is used. A model without a fit is
a guess: the real vehicle is then assumed to turn GUESS_GAIN_FACTOR times as strongly as the model.
"""

from math import inf

import numpy as np

from baqueano.contracts import optional
from baqueano.contracts.blocks import Controller
from baqueano.controllers.heading_hold import MAX_SPEED_SHARE, Gains, Gyro, HeadingHold, pole_placement_gains
from baqueano.drive.session import compile_if_possible
from baqueano.estimators.readings.gate import gate_limit
from baqueano.vehicle_file.file import VehicleFile
from baqueano.vehicles.effort import constant_effort
from baqueano.vehicles.freedoms import is_steered, is_turned_by_last_command
from baqueano.vehicles.rk4 import row_rate_hz
from baqueano.vehicles.state import DynamicVehicle

LINK_DELAY_S = 0.02  # delay of the gyro's filter, of the estimate, and of the wire in both directions
GUESS_GAIN_FACTOR = 2.0
LINEARISATION_SHARE = 0.5  # fraction of the forward limit, for the linearisation
STEP, STEP_RAD_S = 0.1, 0.2  # half the width of a difference: in the turn command, and in the yaw rate
SETTLING_S = 3.0  # a vehicle reaches its speed within this time
MAX_TIME_CONSTANT_S = 10.0  # a larger τ does not change the gains


def with_heading_hold(hand: Controller, vehicle_file: VehicleFile) -> Controller:
    """Return the controller `hand` with a heading hold around it, or `hand` itself without suitable gains."""
    gains = heading_hold_gains(vehicle_file)
    if gains is None:
        return hand
    limit = float(_command_limit(vehicle_file)[-1])
    wheels = getattr(vehicle_file.vehicle.drivetrain, "mixing", "none") == "two_wheels"
    return HeadingHold(hand, gains, limit, MAX_SPEED_SHARE if wheels else inf, _find_gyro(vehicle_file))


def _find_gyro(vehicle_file: VehicleFile) -> Gyro | None:
    estimator, sensors = vehicle_file.estimator(), vehicle_file.sensors
    if not optional.attribute(estimator, "stacks_innovations") or "imu" not in estimator.use:
        return None
    first_index = sum(getattr(sensors, name).size for name in estimator.use[: estimator.use.index("imu")])
    imu_size = sensors.imu.size
    return Gyro(
        slice(first_index, first_index + imu_size),
        vehicle_file.value("sensors.imu.gyro_scale"),
        gate_limit(estimator.gate_sigma, imu_size),
    )


def heading_hold_gains(vehicle_file: VehicleFile) -> Gains | None:
    """Return the gains of the heading hold for the file's model.

    Return None for a vehicle without a gyro, without a forward or turn command, or with a turn response that is too
    small.
    """
    limit, vehicle = _command_limit(vehicle_file), vehicle_file.vehicle
    if (
        "imu" not in vehicle_file.sensors._fields
        or limit[0] <= 0.0
        or limit[-1] <= 0.0
        or not is_turned_by_last_command(vehicle)
    ):
        return None
    for share in (LINEARISATION_SHARE, 1.0):  # at half the limit a vehicle can be in its dead zone
        speed, k, tau_s = _turn_response(vehicle, limit, share, row_rate_hz(vehicle_file.rate_hz))
        if abs(k) * limit[-1] > STEP_RAD_S:
            break
    else:
        return None
    drivetrain, is_servo = vehicle.drivetrain, is_steered(vehicle)
    lag_s = drivetrain.servo_lag_s if is_servo else drivetrain.lag_s
    dead_time_s = lag_s + drivetrain.delay_s + 1.5 / vehicle_file.rate_hz + LINK_DELAY_S
    gains = pole_placement_gains(GUESS_GAIN_FACTOR * k if vehicle_file.is_guess else k, tau_s, dead_time_s)
    return gains._replace(speed_m_s=speed if is_servo else 0.0)


def _command_limit(vehicle_file: VehicleFile) -> np.ndarray:
    limit = np.asarray(vehicle_file.command.limit, dtype=float)
    return np.where(np.isfinite(limit), limit, 1.0)


def _turn_response(
    vehicle: DynamicVehicle, limit: np.ndarray, share: float, rate_hz: float
) -> tuple[float, float, float]:
    """Return speed [m/s], k [rad/s per unit of u_ψ] and τ [s] at the part `share` of the forward limit.

    They follow from r⁺ = a r + (1 − a) k u_ψ over a tick δ, with a = e^(−δ/τ).
    """
    u, du, dt_s = np.zeros(len(limit)), np.zeros(len(limit)), 1.0 / rate_hz
    u[0], du[-1] = share * limit[0], STEP * limit[-1]
    state, drivetrain, inputs = vehicle.init(), vehicle.drivetrain, (u, dt_s, np.zeros(3))
    quick_vehicle, _ = compile_if_possible("vehicle", vehicle, state, inputs, "python")  # hundreds of steps
    for _ in range(round(SETTLING_S * rate_hz)):
        state, _ = quick_vehicle.step(state, *inputs)
    v = float(state.nu[0])

    def next_yaw_rate(r: float, u: np.ndarray) -> float:
        effort = constant_effort(drivetrain.unmix(drivetrain.static_response(drivetrain.mix(u))))
        return float(vehicle.advance(np.zeros(3), np.array([v, 0.0, r]), effort, dt_s)[1][2])

    a = (next_yaw_rate(STEP_RAD_S, u) - next_yaw_rate(-STEP_RAD_S, u)) / (2.0 * STEP_RAD_S)
    a = min(max(a, 0.0), np.exp(-dt_s / MAX_TIME_CONSTANT_S))
    k = (next_yaw_rate(0.0, u + du) - next_yaw_rate(0.0, u - du)) / (2.0 * du[-1] * (1.0 - a))
    return v, k, -dt_s / np.log(a) if a > 0.0 else 0.0
