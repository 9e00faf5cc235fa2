"""Clean the runs of a fit: repair their timestamps, remove samples that are not measurements, name unused sensors."""

from collections.abc import Sequence
from dataclasses import replace

from baqueano.contracts.values import Tree
from baqueano.diagnostics import Diagnostic, note
from baqueano.numerics.parallel import parallel_map
from baqueano.runs.diagnostics import physical_units, samples, timestamps
from baqueano.runs.maps.columns import KINDS
from baqueano.runs.run import Channel, Run
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicle_file.units import NON_MOTION_CHANNELS

SIZE_KINDS = {1: "odometer", 2: "wheels", 3: "imu"}


def clean(
    runs: list[Run], vehicle_file: VehicleFile, sensors: dict[str, Tree]
) -> tuple[list[Run], tuple[Diagnostic, ...]]:
    """Return the runs without impossible measurements, split at jumps of time, and messages on the faults."""

    def clean_run(run: Run) -> tuple[list[Run], list[Diagnostic]]:
        segments, messages = timestamps.check_timestamps(run, vehicle_file.rate_hz)
        messages += physical_units.implausible_values(run, vehicle_file, sensors)
        clean_segments = []
        for segment in segments:
            channels, sample_messages = _samples(segment, sensors)
            messages += sample_messages
            clean_segments.append(channels)
        if len(runs) > 1:
            messages = [replace(m, figures={**m.figures, "of_run": run.name}) for m in messages]
        return clean_segments, messages

    results = parallel_map(clean_run, runs, rows=sum(len(run.t_ns) for run in runs))
    messages = tuple(message for _, messages in results for message in messages)
    return [run for segments, _ in results for run in segments], messages


def _samples(run: Run, sensors: dict[str, Tree]) -> tuple[Run, list[Diagnostic]]:
    channels, messages = dict(run.sensors), []
    for name, block in sensors.items():
        if name in channels and channels[name].z.shape[1] == block.size:
            channels[name], sensor_messages = samples.check_samples(name, block, channels[name])
            messages += sensor_messages
    return replace(run, sensors=channels) if messages else run, messages


def unused_sensors(runs: Sequence[Run], vehicle_file: VehicleFile) -> list[Diagnostic]:
    """Return a note for each motion sensor of the runs that the vehicle file lacks, with its likely kind."""
    channels: dict[str, Channel] = {}
    for run in runs:
        channels |= {name: channel for name, channel in run.sensors.items() if len(channel.z)}
    notes = []
    for name, channel in channels.items():
        if name not in vehicle_file.sensors._fields and name not in NON_MOTION_CHANNELS:
            kind = name if name in KINDS else SIZE_KINDS.get(channel.z.shape[1], "…")
            notes.append(note("use.not-in-file", sensor=name, vehicle=vehicle_file.name, kind=kind))
    return notes
