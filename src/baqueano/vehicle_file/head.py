"""Read the head of a vehicle file: command, geometry, robot and simulation."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.geometry import axes_rotation
from baqueano.parameter import INF, parameter
from baqueano.sensors.imu_filter import ACCEL_RANGES_G, GYRO_RANGES_DPS, MPU6050_BANDS
from baqueano.vehicle_file.tables import ReadReport, arguments, missing_keys, table_keys
from baqueano.vehicles.state import DynamicVehicle

FORMAT_VERSION = 1
TOP_LEVEL_KEYS = ("format", "name", "about", "rate_hz")
TABLE_NAMES = (
    "command", "geometry", "model", "sensors", "estimator", "controller", "guide", "supervisor",
    "robot", "simulation", "provenance", "parameter_cov", "envelope",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Channels:
    """The command u (n,): the names, the unit and the limits of its entries."""

    names: tuple[str, ...]
    limit: np.ndarray = parameter(
        "unit of u", "largest magnitude of each entry", low=0.0, default=(INF,), shape=None
    )
    unit: str = "1"


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """The dimensions of the body, all optional."""

    radius_m: float | None = parameter("m", "radius of a round platform", low=1e-3, high=100.0, default=None)
    length_m: float | None = parameter(
        "m", "length of a rectangular platform", low=1e-3, high=100.0, default=None
    )
    width_m: float | None = parameter(
        "m", "width of a rectangular platform", low=1e-3, high=100.0, default=None
    )
    track_m: float | None = parameter(
        "m", "distance from the left to the right wheel", low=1e-3, high=100.0, default=None
    )
    wheel_radius_m: float | None = parameter("m", "radius of a wheel", low=1e-3, high=10.0, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class Hardware:
    """The wiring of the vehicle, which has no effect in a simulation."""

    port: str = "auto"
    pwm_hz: float = parameter("Hz", "frequency of the motors' PWM", low=50.0, high=20_000.0, default=1000.0)
    slew_per_s: float = parameter(
        "1/s", "largest change of a duty per second", low=1.0, high=1000.0, default=20.0
    )
    dead_man_s: float = parameter(
        "s",
        "time without a command after which the firmware stops the motors",
        low=0.05,
        high=1.0,
        default=0.3,
    )
    telemetry_hz: float = parameter("Hz", "telemetry frames per second", low=10.0, high=200.0, default=100.0)
    least_battery_v: float = parameter(
        "V",
        "voltage below which the vehicle does not drive; 0 if it is not wired",
        low=0.0,
        high=30.0,
        default=0.0,
    )
    counts_per_turn: float | None = parameter(
        "1", "counts of an encoder in a turn of the wheel, all edges", low=1.0, high=1e6, default=None
    )
    imu_bus: float = parameter("1", "number of the I2C bus", low=0.0, high=99.0, default=1.0)
    imu_address: float = parameter("1", "address of the IMU, 104 or 105", low=3.0, high=119.0, default=104.0)
    imu_axes: tuple[str, ...] = ("x", "y", "z")
    imu_accel_range_g: float = parameter("g", "range of the accelerometers", low=2.0, high=16.0, default=4.0)
    imu_gyro_range_dps: float = parameter("°/s", "range of the gyro", low=250.0, high=2000.0, default=1000.0)
    imu_filter: float = parameter(
        "1", "low-pass filter of the IMU, 1 to 6 (3 is 44 Hz); if written, it determines [sensors.imu] low_pass_hz",
        low=1.0, high=6.0, default=3.0,
    )  # fmt: skip
    max_tilt_rad: float = parameter(
        "rad", "tilt above which the vehicle is stopped", low=0.05, high=1.6, default=0.6
    )
    max_temperature_c: float = parameter(
        "°C",
        "temperature of the computer above which the vehicle is stopped",
        low=40.0,
        high=120.0,
        default=82.0,
    )
    least_disk_mb: float = parameter(
        "MB", "free space on the disk below which a drive does not begin", low=1.0, high=1e6, default=200.0
    )


IMU_CHOICES: "dict[str, Collection[int]]" = {
    "imu_accel_range_g": ACCEL_RANGES_G, "imu_gyro_range_dps": GYRO_RANGES_DPS, "imu_filter": MPU6050_BANDS,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """The vehicle that is simulated instead of the vehicle that the file describes."""

    truth: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TopLevelKeys:
    """The keys above the first table."""

    format: int
    name: str
    rate_hz: float = parameter("Hz", "ticks of the loop per second", low=1.0, high=2000.0)
    about: str = ""


def reach_m(geometry: Geometry) -> float | None:
    """Return the distance [m] from the middle of the platform to its farthest edge; None without its dimensions."""
    if geometry.radius_m is not None:
        return geometry.radius_m
    if geometry.length_m is not None and geometry.width_m is not None:
        return 0.5 * float(np.hypot(geometry.length_m, geometry.width_m))
    return None


def solid_inertia(mass_kg: float, geometry: Geometry) -> float | None:
    """Return the inertia of a uniform platform about its middle [kg m²]; None without its dimensions.

    It is ½ m R² of a disc, m (l² + w²)/12 of a plate (errata 4; the paper prints m/R²).
    """
    if geometry.radius_m is not None:
        return 0.5 * mass_kg * geometry.radius_m**2
    if geometry.length_m is not None and geometry.width_m is not None:
        return mass_kg * (geometry.length_m**2 + geometry.width_m**2) / 12.0
    return None


class CommandSpec(NamedTuple):
    """The command u (n,) of a vehicle.

    Attributes
    ----------
    names : tuple of str
        Name of each entry.
    unit : str
        Unit of all entries.
    limit : ndarray (n,) [unit of u]
        Largest absolute value of each entry.

    Examples
    --------
    >>> bq.load("small").command.names
    ('u_x', 'u_y', 'u_psi')
    """

    names: tuple[str, ...]
    unit: str
    limit: np.ndarray


def read_top(report: ReadReport, data: JsonObject) -> TopLevelKeys:
    """Return the keys above the first table. Raise FileError for a missing key, or for another format version."""
    keys = table_keys(TopLevelKeys)
    if "format" not in data:
        report.add_problem(("format",), "vehicle.no-format", expected=FORMAT_VERSION)
        report.raise_problems()
    if data["format"] != FORMAT_VERSION or isinstance(data["format"], bool):
        is_newer = isinstance(data["format"], int) and data["format"] > FORMAT_VERSION
        code, fix = ("newer-format", "pip install --upgrade baqueano") if is_newer else ("other-format", "")
        report.add_problem(
            ("format",), f"vehicle.{code}", fix, value=repr(data["format"]), expected=FORMAT_VERSION
        )
        report.raise_problems()
    values = arguments(report, (), {k: keys[k] for k in TOP_LEVEL_KEYS}, data, other_keys=TABLE_NAMES)
    for name in missing_keys(keys, values):
        if name not in data:
            report.add_problem((name,), "vehicle.no-top-key", example=_example(name))
    for table in ("command", "model"):
        if table not in data:
            report.add_table_problem((table,), "vehicle.no-table")
    report.raise_problems()
    return TopLevelKeys(**values)


def _example(name: str) -> str:
    return {"name": 'name = "my vehicle"', "rate_hz": "rate_hz = 100.0"}.get(name, name)


def read_head(report: ReadReport, data: JsonObject) -> tuple[Channels, Geometry, Hardware, Simulation]:
    """Return the tables [command], [geometry], [robot] and [simulation]. Raise FileError for a wrong value."""
    values = arguments(report, ("command",), table_keys(Channels), data["command"], other_keys=())
    if "names" not in values and "names" not in data["command"]:
        report.add_problem(("command", "names"), "vehicle.no-command-names")
    geometry = arguments(report, ("geometry",), table_keys(Geometry), data.get("geometry", {}), other_keys=())
    hardware = arguments(report, ("robot",), table_keys(Hardware), data.get("robot", {}), other_keys=())
    simulation = arguments(
        report, ("simulation",), table_keys(Simulation), data.get("simulation", {}), other_keys=()
    )
    report.raise_problems()
    robot = Hardware(**hardware)
    _check_imu(report, robot)
    report.raise_problems()
    return Channels(**values), Geometry(**geometry), robot, Simulation(**simulation)


def _check_imu(report: ReadReport, hardware: Hardware) -> None:
    """Check that the chip has these settings, and that its axes are those of a rotation."""
    for key, choices in IMU_CHOICES.items():
        if (value := getattr(hardware, key)) not in choices:
            report.add_problem(("robot", key), "vehicle.no-choice", value=value, valid=list(choices))
    if axes_rotation(hardware.imu_axes) is None:
        report.add_problem(("robot", "imu_axes"), "vehicle.imu-axes", value=list(hardware.imu_axes))


def read_command(report: ReadReport, channels: Channels, vehicle: DynamicVehicle) -> CommandSpec:
    """Return names, unit and limits of the command. Raise FileError if their number does not fit the vehicle."""
    n, names = int(getattr(vehicle, "commands", len(channels.names))), channels.names
    if len(names) != n:
        model = type(vehicle).__name__
        report.add_problem(
            ("command", "names"), "vehicle.command-names", value=len(names), model=model, expected=n
        )
    if len(set(names)) != len(names):
        report.add_problem(("command", "names"), "vehicle.command-name-twice", value=str(list(names)))
    limit = channels.limit
    if limit.shape not in ((1,), (n,)):
        report.add_problem(("command", "limit"), "vehicle.command-limits", value=len(limit), expected=n)
    report.raise_problems()
    return CommandSpec(names, channels.unit, np.broadcast_to(limit, (n,)).copy())
