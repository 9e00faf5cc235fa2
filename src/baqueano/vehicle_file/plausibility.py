"""Refuse values that are within their ranges but contradict each other, and show the calculation.

    radius of gyration  k = √(I/m) ≤ R;   a uniform disc has k = R/√2                                             (1)
    mass per floor area  m/(πR²): a sheet of card has 0.5 kg/m², a block of steel of 0.6 m has 5000               (2)
    RK4 of ẋ = −x/τ is stable while δ < 2.785 τ,  1/τ = (d_l + d_k/ν_k)/m                                        (3)

Without a radius (1) is only a notice, so that the paper's case study can be loaded as printed (errata 4).
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.contracts.blocks import SensorBlocks
from baqueano.contracts.optional import has_field, is_dynamic
from baqueano.contracts.time_limit import HANG_S, within
from baqueano.diagnostics import Diagnostic, note
from baqueano.errors import error_text, is_interruption, user_code_place
from baqueano.parameter import all_parameters
from baqueano.symbolic import value_at_path, with_value
from baqueano.vehicle_file.head import Channels, Geometry, reach_m, solid_inertia
from baqueano.vehicle_file.tables import ReadReport, format_array
from baqueano.vehicles.freedoms import damping_derivatives, decay_rates
from baqueano.vehicles.rk4 import row_rate_hz
from baqueano.vehicles.state import DynamicVehicle

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

MIN_DENSITY_KG_M2, MAX_DENSITY_KG_M2 = 0.5, 5000.0  # kg per m² of floor
RK4_LIMIT = 2.785
MIN_DENSITY_KG_M3 = 20.0  # kg/m³: the least plausible density of a body
MAX_SPEED_M_S, MAX_YAW_RATE_RAD_S = 30.0, 100.0  # m/s, rad/s: beyond, a notice


def check_values(
    report: ReadReport, vehicle: DynamicVehicle, sensors: SensorBlocks, geometry: Geometry, channels: Channels,
    rate_hz: float,
) -> None:  # fmt: skip
    """Check the values of a vehicle and its sensors against each other, and add contradictions to `report`."""
    _check_body(report, vehicle, geometry)
    _check_drive(report, vehicle, channels, rate_hz)
    _check_sensors(report, sensors, geometry)


def value_problems(
    vehicle_file: "VehicleFile", vehicle: DynamicVehicle, sensors: SensorBlocks
) -> list[Diagnostic]:
    """Return the problems for which `vehicle_file` would be refused with the values of `vehicle` and `sensors`."""
    report = ReadReport(vehicle_file.label, vehicle_file.text)
    command = vehicle_file.command
    channels = Channels(command.names, command.limit, command.unit)
    check_values(report, vehicle, sensors, vehicle_file.geometry, channels, vehicle_file.rate_hz)
    return report.problems


def _check_body(report: ReadReport, vehicle: DynamicVehicle, geometry: Geometry) -> None:
    """Check mass, inertia and dimensions of a rigid body, and add contradictions to `report`.  (1), (2)"""
    _check_measures(report, geometry)
    mass, inertia = getattr(vehicle, "mass_kg", None), getattr(vehicle, "inertia_kg_m2", None)
    R = reach_m(geometry)
    if isinstance(mass, float) and R is not None:
        _check_mass(report, mass, R)
    if isinstance(mass, float) and isinstance(inertia, float):
        _check_inertia(report, mass, inertia, geometry)
    c = getattr(vehicle, "centre_of_mass_x_m", 0.0)
    if R is not None and abs(c) > R:
        report.add_problem(
            ("model", "centre_of_mass_x_m"),
            "vehicle.centre-of-mass",
            value=c,
            radius_m=R,
            unit_name=_unit(c, R),
        )


def _check_measures(report: ReadReport, g: Geometry) -> None:
    if g.radius_m is not None and (g.length_m is not None or g.width_m is not None):
        report.add_problem(("geometry", "radius_m"), "vehicle.two-shapes")
    R = reach_m(g)
    if R is None:
        return
    if g.track_m is not None and g.track_m > 2.4 * R:
        report.add_problem(
            ("geometry", "track_m"),
            "vehicle.track",
            value=g.track_m,
            across_m=2 * R,
            unit_name=_unit(g.track_m, 2 * R),
        )
    if g.wheel_radius_m is not None and g.wheel_radius_m > 2.0 * R:
        report.add_problem(
            ("geometry", "wheel_radius_m"),
            "vehicle.wheel",
            value=g.wheel_radius_m,
            across_m=2 * R,
            unit_name=_unit(g.wheel_radius_m, R),
        )


def _check_mass(report: ReadReport, mass: float, R: float) -> None:
    area = np.pi * R**2
    if MIN_DENSITY_KG_M2 <= mass / area <= MAX_DENSITY_KG_M2:
        return
    code = "vehicle.too-heavy" if mass / area > MAX_DENSITY_KG_M2 else "vehicle.too-light"
    report.add_problem(("model", "mass_kg"), code, value=mass, radius_m=R, density_kg_m2=mass / area)


def _check_inertia(report: ReadReport, mass: float, inertia: float, geometry: Geometry) -> None:
    k = float(np.sqrt(inertia / mass))
    R, uniform_inertia = reach_m(geometry), solid_inertia(mass, geometry)
    path = ("model", "inertia_kg_m2")
    figures: dict[str, Any] = {"value": inertia, "mass_kg": mass, "gyration_m": k}
    if R is None or uniform_inertia is None:
        largest_m = (mass / MIN_DENSITY_KG_M3) ** (1.0 / 3.0)
        if k > largest_m:
            report.add_notice(path, "vehicle.inertia-unchecked", **figures)
        return
    shape = "disc" if geometry.radius_m else "plate"
    measure = note(f"vehicle.{shape}", radius_m=R, uniform_kg_m2=uniform_inertia)
    if k > R:
        report.add_problem(path, "vehicle.inertia-too-large", measure=measure, **figures)
    elif k < R / 20.0:
        report.add_problem(path, "vehicle.inertia-of-point", measure=measure, **figures)


def _check_drive(report: ReadReport, vehicle: DynamicVehicle, channels: Channels, rate_hz: float) -> None:
    """Check that the vehicle can move, that a tick is short enough to integrate it, and that its speed is plausible."""
    _check_dead_zones(report, vehicle, channels)
    if is_dynamic(vehicle) and _has_acceleration(report, vehicle):
        _check_steps(report, vehicle, rate_hz)
        _notice_speed(report, vehicle, channels)


def _has_acceleration(report: ReadReport, vehicle: DynamicVehicle) -> bool:
    """Return True if nu_dot returns a finite, real array (3,) at rest; otherwise add a problem."""
    try:
        with np.errstate(all="ignore"):
            acceleration = within(HANG_S, vehicle.nu_dot, np.zeros(3), np.zeros(vehicle.commands), 0.0)
    except BaseException as error:
        if is_interruption(error):
            raise
        name = f"{type(vehicle).__name__} ({user_code_place(error)})"
        report.add_table_problem(("model",), "vehicle.not-built", block=name, error=error_text(error))
        return False
    is_real = isinstance(acceleration, np.ndarray) and acceleration.dtype.kind in "biuf"
    if is_real and acceleration.shape == (3,) and np.all(np.isfinite(acceleration)):
        return True
    figures = {"vehicle": type(vehicle).__name__, "value": repr(acceleration)}
    report.add_problem(("model", "kind"), "vehicle.acceleration", **figures)
    return False


def _check_dead_zones(report: ReadReport, vehicle: DynamicVehicle, channels: Channels) -> None:
    drivetrain = vehicle.drivetrain
    if not has_field(drivetrain, "dead_zone_forward"):  # a drivetrain of the user
        return
    end = np.minimum(drivetrain.limit, np.sum(channels.limit))
    for name in ("dead_zone_forward", "dead_zone_backward"):
        zone = getattr(drivetrain, name)
        if np.any(zone >= end):
            report.add_problem(
                ("model", "drivetrain", name),
                "vehicle.dead-zone",
                value=format_array(zone),
                end=format_array(end),
                unit_name=channels.unit,
            )


def _check_steps(report: ReadReport, vehicle: DynamicVehicle, rate_hz: float) -> None:
    """Add a problem for friction whose time constant is below row/2.785, because RK4 is then unstable.  (3)"""
    fading_rates, row_rate = decay_rates(vehicle), row_rate_hz(rate_hz)
    for i in np.flatnonzero(fading_rates > RK4_LIMIT * row_rate):
        path, _, entry = _fastest_path(vehicle, int(i)).partition("[")
        steps = format_array(np.asarray(value_at_path({"model": vehicle}, path)))
        report.add_problem(
            tuple(path.split(".")), "vehicle.entry-too-stiff" if entry else "vehicle.too-stiff", value=steps,
            entry=entry[:-1], decay_ms=1e3 / fading_rates[i], rate_hz=rate_hz, step_ms=1e3 / row_rate,
            maximum=RK4_LIMIT, keys=["rate_hz", *_slowing_keys(vehicle, path, int(i))],
        )  # fmt: skip


def _fastest_path(vehicle: DynamicVehicle, i: int) -> str:
    """Return the path of the friction that damps motion along axis i most, or of a time constant without friction."""
    model, model_fields = {"model": vehicle}, dict(all_parameters(vehicle, "model"))
    rate_by_path = {
        path: derivative[i] * float(value_at_path(model, path))
        for path, derivative in damping_derivatives(vehicle, model_fields)
    }
    if any(x > 0.0 for x in rate_by_path.values()):
        return max(rate_by_path, key=lambda path: rate_by_path[path])
    candidates = [k for k, p in model_fields.items() if p.shape == ()]
    free_keys = [k for k in candidates if model_fields[k].role == "free"]
    return min(
        free_keys or candidates,
        key=lambda k: decay_rates(with_value(model, k, 1.01 * value_at_path(model, k))["model"])[i],
    )


def _slowing_keys(vehicle: DynamicVehicle, path: str, i: int) -> list[str]:
    """Return keys in the table of `path` that would slow the decay of motion along axis i if they were larger.

    Keys of quantities that the user measures are excluded.
    """
    model, table, present_rate = {"model": vehicle}, path.rpartition(".")[0], decay_rates(vehicle)[i]
    candidates = [
        k for k, p in all_parameters(value_at_path(model, table), table) if k != path and not p.measured_by
    ]
    changed_models = {k: with_value(model, k, 1.01 * np.asarray(value_at_path(model, k))) for k in candidates}
    return [
        k.rpartition(".")[2]
        for k, changed_model in changed_models.items()
        if decay_rates(changed_model["model"])[i] < 0.999 * present_rate
    ]


def _notice_speed(report: ReadReport, vehicle: DynamicVehicle, channels: Channels) -> None:
    """Add a notice if a command at its limit still accelerates the vehicle at the speed MAX_SPEED_M_S or
    MAX_YAW_RATE_RAD_S.
    """
    drivetrain, limit = vehicle.drivetrain, np.broadcast_to(channels.limit, (vehicle.commands,))
    for u in np.diag(np.where(np.isfinite(limit), limit, 0.0)):
        effort = drivetrain.unmix(drivetrain.static_response(drivetrain.mix(u)))
        for i, speed, unit in ((0, MAX_SPEED_M_S, "m/s"), (2, MAX_YAW_RATE_RAD_S, "rad/s")):
            nu = speed * np.eye(3)[i]
            if np.any(u) and (
                vehicle.nu_dot(nu, effort, 0.0)[i] > 0.0 or vehicle.nu_dot(-nu, effort, 0.0)[i] < 0.0
            ):
                report.add_notice(("model",), "vehicle.too-fast", maximum=speed, unit_name=unit)
                return


def _check_sensors(report: ReadReport, sensors: SensorBlocks, geometry: Geometry) -> None:
    """Check that each sensor is on the vehicle: its lever arm is at most 1.5 times the known distance to the edge."""
    R = reach_m(geometry)
    for name, sensor in sensors._asdict().items():
        arm = getattr(sensor, "lever_arm_m", None)
        if R is not None and isinstance(arm, np.ndarray) and np.hypot(*arm) > 1.5 * R:
            distance = float(np.hypot(*arm))
            report.add_problem(
                ("sensors", name, "lever_arm_m"),
                "vehicle.lever-arm",
                value=format_array(arm),
                distance_m=distance,
                radius_m=R,
                unit_name=_unit(distance, R),
            )


def _unit(value: float, expected: float) -> Diagnostic:
    """Return a guess of the unit: cm or mm if a division by 100 or 1000 yields a plausible value, else metres."""
    for factor, unit in ((100.0, "cm"), (1000.0, "mm")):
        if abs(value) / factor <= 1.5 * expected:
            return note("vehicle.in-unit", unit_name=unit, value=value, value_m=value / factor)
    return note("vehicle.in-metres")
