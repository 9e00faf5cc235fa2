"""Commands and readings held against physics before anything is fitted.

    |u_j| ≤ limit_j of the vehicle file        |ω_z| ≤ 35 rad/s, 2000 °/s        |a| ≤ 300 m/s²            (1)
    mean of a_x, a_y at rest ≈ bias + 9.8 sin(tilt),  both small for an IMU that lies flat                (2)

A vehicle that turns faster than every small gyro can say is one whose gyro tells degrees. An accelerometer
of the plane that shows 9.8 m/s² all the time is one that points up.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.identify.doubts import turning
from baqueano.identify.doubts.finding import REFUSED, WARN, Finding
from baqueano.runs.diagnostics.plausible import FASTEST_RAD_S
from baqueano.runs.run import Run
from baqueano.signals import STANDARD_GRAVITY

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

HARDEST_M_S2 = 300.0  # that anything on a small vehicle feels for long
TILTED_M_S2 = 3.0  # of gravity in the plane: mounted 18° off
OVER = 1.2  # times the limit: rounding and trims are less
FEW = 20  # ticks at rest
FULL = ((200.0, 256.0, "PWM counts of 255"), (90.0, 101.0, "per cent"))  # from, to


def checked(run: Run, file: "VehicleFile", sensors: dict[str, Any]) -> list[Finding]:
    """What no small vehicle does, or its file does not allow."""
    found = _commands(run, file)
    for name, block in sensors.items():
        if (
            hasattr(block, "gyro_scale")
            and name in run.sensors
            and run.sensors[name].z.shape[1] == block.size
        ):
            found += _imu(run, name, block)
            found += turning.checked(run, file, name)
    return found


def _commands(run: Run, file: "VehicleFile") -> list[Finding]:
    found = []
    for j, (name, limit) in enumerate(zip(file.command.names, file.command.limit, strict=True)):
        most = float(np.nanmax(np.abs(run.applied[:, j]), initial=0.0))
        if not np.isfinite(limit) or most <= OVER * limit or most == 0.0:
            continue
        if limit == 0.0:
            said = f"{name} reaches {most:.3g}, and the vehicle file allows 0: are columns swapped?"
            found.append(Finding("command range", WARN, said))
            continue
        guess = next((what for low, high, what in FULL if low <= most <= high), "volts")
        said = (
            f"{name} reaches {most:.4g}, and the vehicle file allows {limit:g} ({file.command.unit}): is it in "
            f"{guess}? Bring it to the unit of the file, or write the true limit"
        )
        found.append(Finding("command unit", REFUSED, said))
    return found


def _imu(run: Run, name: str, block: Any) -> list[Finding]:
    z, found = run.sensors[name].z, []
    size = np.abs(z[np.isfinite(z).all(axis=1)])
    if not len(size):
        return []
    far = np.any(size > [HARDEST_M_S2, HARDEST_M_S2, FASTEST_RAD_S])
    most = np.quantile(size, 0.99, axis=0) if far else np.zeros(3)
    if most[2] > FASTEST_RAD_S:
        said = f"{name}[2] reaches {most[2]:.0f} rad/s, and small gyros tell up to {FASTEST_RAD_S:g}: is it in °/s?"
        found.append(Finding("gyro unit", REFUSED, said))
    for i in np.flatnonzero(most[:2] > HARDEST_M_S2):
        said = f"{name}[{i}] reaches {most[i]:.0f} m/s²: are these counts of a converter?"
        found.append(Finding("accelerometer unit", REFUSED, said))
    return found + _gravity(run, name, block)


def _gravity(run: Run, name: str, block: Any) -> list[Finding]:
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
            said = (
                f"{name}[{i}] is {off:+.2f} m/s² off {'at rest' if rest.sum() >= FEW else 'all the time'}: gravity, "
                f"as on an IMU that does not lie flat; swap its axes, or tell tilt_rad"
            )
            found.append(Finding("gravity", REFUSED if whole else WARN, said))
    return found
