"""Commands and readings held against physics before anything is fitted.

    |u_j| ≤ limit_j of the vehicle file        |ω_z| ≤ 35 rad/s, 2000 °/s        |a| ≤ 300 m/s²            (1)
    mean of a_x, a_y at rest ≈ bias + 9.8 sin(tilt),  both small for an IMU that lies flat                (2)

A vehicle that turns faster than every small gyro can say is one whose gyro tells degrees. An accelerometer
of the plane that shows 9.8 m/s² all the time is one that points up.
"""

from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.diagnostics import turning
from baqueano.runs.diagnostics.plausible import FASTEST_RAD_S
from baqueano.runs.run import Run
from baqueano.signals import STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.runs.run import Run
    from baqueano.vehicle_file import VehicleFile

HARDEST_M_S2 = 300.0  # that anything on a small vehicle feels for long
TILTED_M_S2 = 3.0  # of gravity in the plane: mounted 18° off
OVER = 1.2  # times the limit: rounding and trims are less
FEW = 20  # ticks at rest
FULL = ((200.0, 256.0, "PWM (0 … 255)"), (90.0, 101.0, "%"))  # from, to


def checked(run: Run, file: "VehicleFile", sensors: dict[str, Tree]) -> list[Diagnostic]:
    """What no small vehicle does, or its file does not allow."""
    found = _commands(run, file)
    for name, block in sensors.items():
        if (
            has_field(block, "gyro_scale")
            and name in run.sensors
            and run.sensors[name].z.shape[1] == block.size
        ):
            found += _imu(run, name, block)
            found += turning.checked(run, file, name)
    return found


def _commands(run: Run, file: "VehicleFile") -> list[Diagnostic]:
    found = []
    for j, (name, limit) in enumerate(zip(file.command.names, file.command.limit, strict=True)):
        most = float(np.nanmax(np.abs(run.applied[:, j]), initial=0.0))
        if not np.isfinite(limit) or most <= OVER * limit or most == 0.0:
            continue
        if limit == 0.0:
            found.append(note("command.beyond-zero", Severity.WARNING, subject=name, most=most))
            continue
        guess = next((what for low, high, what in FULL if low <= most <= high), "V")
        told = {"most": most, "limit": float(limit), "of_file": file.command.unit, "guess": guess}
        found.append(note("command.unit", Severity.ERROR, subject=name, **told))
    return found


def _imu(run: Run, name: str, block: Tree) -> list[Diagnostic]:
    z, found = run.sensors[name].z, []
    size = np.abs(z[np.isfinite(z).all(axis=1)])
    if not len(size):
        return []
    far = np.any(size > [HARDEST_M_S2, HARDEST_M_S2, FASTEST_RAD_S])
    most = np.quantile(size, 0.99, axis=0) if far else np.zeros(3)
    if most[2] > FASTEST_RAD_S:
        rates: JsonObject = {"most_rad_s": float(most[2]), "fastest_rad_s": FASTEST_RAD_S}
        found.append(note("gyro.too-fast", Severity.ERROR, subject=f"{name}[2]", **rates))
    for i in np.flatnonzero(most[:2] > HARDEST_M_S2):
        said = {"subject": f"{name}[{i}]", "most_m_s2": float(most[i])}
        found.append(note("accelerometer.unit", Severity.ERROR, **said))
    return found + _gravity(run, name, block)


def _gravity(run: Run, name: str, block: Tree) -> list[Diagnostic]:
    channel = run.sensors[name]
    tick = np.minimum(np.searchsorted(run.t_ns, channel.t_ns), len(run.t_ns) - 1)
    rest = ~np.any(run.applied != 0.0, axis=1)[tick]
    where = rest if rest.sum() >= FEW else np.ones(len(tick), bool)
    phi, theta = block.tilt_rad
    told = block.accel_bias + STANDARD_GRAVITY * np.array([-np.sin(theta), np.sin(phi) * np.cos(theta)])
    found = []
    for i in range(2):
        x = channel.z[where, i]
        x = x[np.isfinite(x)]
        tilted = np.count_nonzero(np.abs(x - told[i]) > TILTED_M_S2)  # fewer than half move no median
        off = float(np.median(x)) - float(told[i]) if tilted and 2 * tilted >= len(x) else 0.0
        if abs(off) > TILTED_M_S2:
            whole = abs(abs(off) - STANDARD_GRAVITY) < 0.1 * STANDARD_GRAVITY and rest.sum() >= FEW
            code = "gravity.at-rest" if rest.sum() >= FEW else "gravity.all-the-time"
            grave = Severity.ERROR if whole else Severity.WARNING
            found.append(note(code, grave, subject=f"{name}[{i}]", off_m_s2=off))
    return found
