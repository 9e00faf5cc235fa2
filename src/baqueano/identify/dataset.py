"""Run the first stages of a fit: clean the runs, choose the sensors, and choose the free parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.rest import MIN_REST_S, REST_S, with_rest_gyro_bias
from baqueano.calibration.tolerances import measured_gyro_bias_std
from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import UsageError
from baqueano.identify.data.added_channels import TRUTH, with_hand_measurements, with_truth
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.options import FitOptions
from baqueano.identify.parameters.free import free_parameters, has_offset
from baqueano.identify.parameters.theta import Parameters, fit_parameters
from baqueano.identify.residuals.gyro_aided import gyro_aided_paths
from baqueano.runs.diagnostics.cleaning import clean
from baqueano.runs.run import Run
from baqueano.signals import sensor_slots

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Cleaned runs, and the part of the vehicle that explains them.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle file. Its gyro bias is the value measured at rest, if the runs contain a rest.
    blocks : FittedBlocks
        The model, and the sensors that are used.
    runs : tuple of Run
        The runs without invalid samples.
    channels : dict of str to list of int
        Channels in use (name of the sensor → indices), only for sensors of which some channels are not used.
    findings : tuple of Diagnostic
        Faults of the data.
    note : Diagnostic, optional
        Message on the zero of the gyro.

    Examples
    --------
    >>> small = bq.load("small")
    >>> dataset([bq.simulate(small, np.full((500, 3), [0.5, 0.0, 0.2]))], small).is_usable
    True
    """

    vehicle_file: "VehicleFile"
    blocks: FittedBlocks
    runs: tuple[Run, ...]
    channels: dict[str, list[int]]
    findings: tuple[Diagnostic, ...]
    note: Diagnostic | None = None

    @property
    def is_usable(self) -> bool:
        """Return True if none of the findings is an error, so that a fit is possible."""
        return not any(finding.severity == Severity.ERROR for finding in self.findings)


def dataset(
    runs: Sequence[Run],
    vehicle_file: "VehicleFile",
    use: Sequence[str] | None = None,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
) -> Dataset:
    """Return the runs as a fit of this vehicle file reads them.

    Parameters
    ----------
    runs : sequence of Run
        One or more.
    vehicle_file : VehicleFile
        The vehicle that drove the runs.
    use : sequence of str, optional
        Sensors, or channels such as "imu[2]"; default: all sensors of the file that have readings in every run.
    options : FitOptions
        Options of the fit.

    Returns
    -------
    Dataset
        The cleaned runs; `findings` lists the faults of the data.

    Raises
    ------
    UsageError
        If the runs or the sensors do not fit the vehicle file.

    Examples
    --------
    >>> small = bq.load("small")
    >>> dataset([bq.simulate(small, np.full((500, 3), [0.5, 0.0, 0.2]))], small, ["imu[2]"]).channels
    {'imu': [2]}
    """
    runs, bias_note = list(runs), None
    check_command_count(vehicle_file, runs)
    if options.biases:
        vehicle_file, bias_note = with_rest_gyro_bias(vehicle_file, runs)
        bias_note = bias_note or _unmeasured_bias(vehicle_file, runs)
    blocks, runs, channels = select_sensors(vehicle_file, runs, use)
    runs, blocks = with_hand_measurements(runs, blocks, options.measured)
    runs, findings = clean(runs, vehicle_file, blocks.sensors._asdict())
    return Dataset(vehicle_file, blocks, tuple(runs), channels, findings, bias_note)


def _unmeasured_bias(vehicle_file: "VehicleFile", runs: Sequence[Run]) -> Diagnostic | None:
    """Return a note on a gyro whose bias was never measured, for a vehicle with an offset; else None."""
    for name, sensor in vehicle_file.sensors._asdict().items():
        channels = [run.sensors[name].z[:, -1] for run in runs if name in run.sensors]
        is_in_runs = any(np.isfinite(z).any() for z in channels)
        if not (has_field(sensor, "gyro_bias") and is_in_runs and has_offset(vehicle_file.vehicle)):
            continue
        if measured_gyro_bias_std(vehicle_file, name) is None:
            return note("bias.no-rest", subject=name, rest_s=REST_S + MIN_REST_S)
    return None


def parameters_of(
    data: Dataset,
    free: Sequence[str] | None = None,
    options: FitOptions = FitOptions(),  # noqa: B008  it is frozen
) -> Parameters:
    """Return the parameters that a fit searches for.

    Parameters
    ----------
    data : Dataset
        The runs, and the vehicle that drove them.
    free : sequence of str, optional
        As in `identify`.
    options : FitOptions
        Options of the fit.

    Returns
    -------
    Parameters
        θ (p,), its start and its bounds.

    Raises
    ------
    UsageError
        For a path that is not a parameter or does not have an effect, and if no command moved.

    Examples
    --------
    >>> small = bq.load("small")
    >>> data = dataset([bq.simulate(small, np.full((500, 3), [0.5, 0.0, 0.2]))], small)
    >>> [one.path for one in parameters_of(data, ["model.mass_kg"]).free]
    ['model.mass_kg']
    """
    if options.gyro_leads:
        free = gyro_aided_paths(data.blocks, free, data.vehicle_file.name)
    fixed_paths, runs = (*options.fixed, *options.per_run), () if options.gyro_leads else data.runs
    parameters = free_parameters(data.blocks, free, fixed_paths, options.bounds, data.channels, runs)
    return fit_parameters(
        data.blocks, parameters, data.runs, data.channels, data.vehicle_file.rate_hz, options
    )


def check_command_count(vehicle_file: "VehicleFile", runs: Sequence[Run]) -> None:
    """Raise UsageError if a run has another number of commands than the vehicle."""
    n = vehicle_file.vehicle.commands
    for run in runs:
        if run.applied_commands.shape[1] != n:
            names: JsonObject = {"run": run.name, "vehicle": vehicle_file.name}
            counts: JsonObject = {"commands": run.applied_commands.shape[1], "expected": n}
            raise UsageError.of("runs.other-vehicle", "--vehicle FILE", **names, **counts)


def select_sensors(
    vehicle_file: "VehicleFile", runs: list[Run], use: Sequence[str] | None
) -> tuple[FittedBlocks, list[Run], dict[str, list[int]]]:
    """Return the blocks with the sensors in use, the runs, and the channels of partly used sensors. If `use` names the
    truth, the truth becomes a sensor. Raise UsageError without runs, for an unknown sensor or channel, or if no sensor
    has readings in all runs."""
    if not runs:
        raise UsageError.of("runs.none", "bq.identify(run, robot)")
    file_sensors = vehicle_file.sensors._fields
    if use is None:
        use = [
            name for name in file_sensors if all(name in r.sensors and len(r.sensors[name].z) for r in runs)
        ]
        if not use:
            raise _no_common_sensor(file_sensors, runs)
    sensors, channels = vehicle_file.sensors, _sensor_channels(use)
    names = list(dict.fromkeys(channel.partition("[")[0] for channel in use))
    if TRUTH in names:
        runs, sensors = with_truth(runs, sensors)
    for name in names:
        if name not in sensors._fields:
            raise UsageError.of("use.unknown", sensor=name, valid=file_sensors)
        size = getattr(sensors, name).size
        if name in channels and max(channels[name]) >= size:
            raise UsageError.of("use.no-channel", sensor=name, entry=max(channels[name]), last=size - 1)
    used_sensors = sensor_slots(tuple(names))(*(getattr(sensors, name) for name in names))
    return FittedBlocks(vehicle_file.vehicle, used_sensors), runs, channels


def _no_common_sensor(names: Sequence[str], runs: list[Run]) -> UsageError:
    """Return the error for runs without a common sensor. `names` are the sensors of the file."""
    sensor_sets = [{name for name, channel in run.sensors.items() if len(channel.z)} for run in runs]
    name = max(names, key=lambda name: sum(name in sensors for sensors in sensor_sets), default="")
    other_runs = [run.name for run, sensors in zip(runs, sensor_sets, strict=True) if name not in sensors]
    if len(other_runs) < len(runs):
        # the channel is recorded, but a run lacks its readings
        is_recorded = all(name in run.sensors for run in runs)
        code = "use.read-in-some" if is_recorded else "use.not-in-all"
        return UsageError.of(code, runs=other_runs, sensor=name)
    return UsageError.of("use.nothing-common", sensors=sorted(set().union(*sensor_sets)), valid=names)


def _sensor_channels(use: Sequence[str]) -> dict[str, list[int]]:
    """Return the channels of each sensor that `use` names only by entries such as "imu[2]", or raise UsageError."""
    channels: dict[str, list[int]] = {}
    for channel in use:
        name, bracket, entry = channel.partition("[")
        if bracket and name not in use:
            if not entry.rstrip("]").isdigit():
                raise UsageError.of("use.unreadable", value=channel)
            channels.setdefault(name, []).append(int(entry.rstrip("]")))
    return channels
