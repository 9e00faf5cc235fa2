"""Report, before a drive, the commands or laps that the vehicle will not drive as requested."""

import numpy as np

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.guides.route import Route
from baqueano.vehicle_file import VehicleFile

LIMIT_ROUNDING = 1e-9  # fraction of a limit: a command that exceeds it by less is not clipped


def clipping_notes(vehicle_file: VehicleFile, u: np.ndarray) -> list[Diagnostic]:
    """Return a warning for each entry of the commands `u` (N, n) that the supervisor clips to its limit."""
    limit, names = vehicle_file.supervisor().limit, vehicle_file.command.names
    max_command = np.max(np.abs(u), axis=0)
    clipped_share = np.mean(np.abs(u) > limit * (1.0 + LIMIT_ROUNDING), axis=0)
    return [
        note(
            "drive.clipped", Severity.WARNING, subject=names[k], share=100.0 * float(clipped_share[k]),
            largest=float(max_command[k]), limit=float(limit[k]), unit=vehicle_file.command.unit,
        )
        for k in np.flatnonzero(clipped_share)
    ]  # fmt: skip


def lap_notes(route: Route, laps: int) -> list[Diagnostic]:
    """Return a warning if another number of laps than 1 is requested along an open route."""
    return [] if route.closed or laps == 1 else [note("drive.open-laps", Severity.WARNING)]
