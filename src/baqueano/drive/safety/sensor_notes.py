"""Report, before a drive, what the vehicle file lacks for its sensors: their noise, or their place in `use`."""

from baqueano.contracts import optional
from baqueano.contracts.blocks import Estimator
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.estimators.readings.velocity_readings import pose_sensors, velocity_rows
from baqueano.vehicle_file import VehicleFile

FORWARD = 0  # the entry of ν


def sensor_warnings(vehicle_file: VehicleFile, estimator: Estimator) -> list[Diagnostic]:
    """Return warnings about sensors without noise, and about sensors of pose and speed that this estimator ignores.

    >>> import baqueano as bq
    >>> small = bq.load("small")
    >>> sensor_warnings(small, small.estimator())
    []
    """
    warnings = []
    if names := vehicle_file.sensors_without_noise:
        warnings.append(
            note("drive.usual-noise", Severity.WARNING, "baqueano identify last --update", sensors=names)
        )
    if ignored_names := _ignored_sensors(vehicle_file, estimator):
        use = ", ".join(f'"{name}"' for name in (*getattr(estimator, "use", ()), *ignored_names))
        warnings.append(
            note(
                "drive.sensor-ignored", Severity.WARNING, f"[estimator] use = [{use}]", sensors=ignored_names
            )
        )
    return warnings


def _ignored_sensors(vehicle_file: VehicleFile, estimator: Estimator) -> list[str]:
    """Return the names of sensors of pose or speed that a filter, which gates the sensors in `use`, does not read."""
    if not (vehicle_file.sensors and optional.has_field(estimator, "gate_sigma")):
        return []
    used_names = {name.partition("[")[0] for name in getattr(estimator, "use", ())}
    speed_sensors = [
        name
        for name, sensor in vehicle_file.sensors._asdict().items()
        if any(row[FORWARD] != 0.0 for row in velocity_rows(sensor).values())
    ]
    names = dict.fromkeys([*pose_sensors(vehicle_file.sensors), *speed_sensors])
    return [name for name in names if used_names and name not in used_names]
