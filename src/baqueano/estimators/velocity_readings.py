"""Which sensor shows which velocity, read from its h: a sensor of your own is served as ours are.

Rows of z = h(η, ν, ν̇) that depend on ν alone are readings of a velocity. One of ν_ψ alone is a gyro and comes first;
wheels and odometers follow, each for those entries of ν that nothing before it shows:

    z = h(0) + H ν,    L H_u = I,   L = (H_uᵀ H_u)⁻¹ H_uᵀ,   u the entries that it gives                  (1)

so ν + L (z − h(ν)) is what the sensor shows, calibrated by its block.
"""

from typing import Any, NamedTuple

import numpy as np

from baqueano.sensors.sampling import low_pass_s
from baqueano.signals import Motion, Slot
from baqueano.symbolic import jacobian

# any curve on which no term of h vanishes: (η, ν, ν̇)
CURVE = np.array([0.3, -0.2, 0.7, 0.5, 0.1, 0.9, 0.2, 0.1, -0.4])
REST = Motion(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(2))
SIDEWAYS, TURNING = 1, 2


class Reading(NamedTuple):
    """What a sensor shows of ν."""

    name: str  # of the sensor
    rows: tuple[int, ...]  # of its z
    of: tuple[int, ...]  # entries of ν that it gives
    at_rest: np.ndarray  # h(0) (m,)
    slopes: np.ndarray  # H (m, 3)
    inverse: np.ndarray  # L (3, m); rows of zeros for the entries that it does not give

    @property
    def is_gyro(self) -> bool:
        """Return True where it shows the turning and nothing else."""
        return self.of == (TURNING,)


def check_use(sensors: Any, use: tuple[str, ...]) -> None:
    """Raise ValueError for a name in `use` that no sensor of the vehicle has."""
    names = getattr(sensors, "_fields", ())
    for name in use:
        if name not in names:
            raise ValueError(
                f'use = "{name}": the vehicle has no such sensor; it has {", ".join(names) or "none"}.'
            )


def readings_of(sensors: Any, use: tuple[str, ...] = ()) -> tuple[Reading, ...]:
    """Return the readings of the sensors named in `use`, of all where none is named; gyros first."""
    check_use(sensors, use)
    slopes = {name: slopes_of(getattr(sensors, name)) for name in use or getattr(sensors, "_fields", ())}
    gyros = [name for name, rows in slopes.items() if any(is_turning(slope) for slope in rows.values())]
    found: list[Reading] = []
    for name in [*gyros, *(name for name in slopes if name not in gyros)]:
        rows = {k: slope for k, slope in slopes[name].items() if name not in gyros or is_turning(slope)}
        given = {i for reading in found for i in reading.of}
        of = [i for i in range(3) if i not in given and any(slope[i] != 0.0 for slope in rows.values())]
        if len(of) > len(rows):
            of = [i for i in of if i != SIDEWAYS]  # the model says it
        if of and len(of) <= len(rows):
            H, at_rest = np.array(list(rows.values())), getattr(sensors, name).h(REST)[list(rows)]
            found.append(Reading(name, tuple(rows), tuple(of), at_rest, H, left_inverse(H, of)))
    return tuple(found)


def slopes_of(sensor: Any) -> dict[int, np.ndarray]:
    """Return ∂h/∂ν (3,) of each row of h that depends on ν alone."""
    slopes = jacobian(lambda x: sensor.h(Motion(x[:3], x[3:6], x[6:], np.zeros(2))))(CURVE)
    return {
        k: row[3:6]
        for k, row in enumerate(slopes)
        if np.any(row[3:6]) and not np.any(row[[0, 1, 2, 6, 7, 8]])
    }


def velocity(readings: tuple[Reading, ...], sensors: Any, slots: Any, nu: np.ndarray) -> Any:
    """Return ν (3,) with what all readings show."""
    for reading in readings:
        nu = replaced(reading, getattr(sensors, reading.name), getattr(slots, reading.name), nu)
    return nu


def show_place(sensors: Any) -> tuple[str, ...]:
    """Return the names of the sensors that show where the vehicle is: h depends on η."""
    return tuple(name for name, sensor in sensors._asdict().items() if np.any(_slopes(sensor)[:, :3]))


def _slopes(sensor: Any) -> np.ndarray:
    """Return ∂h/∂(η, ν, ν̇) (m, 9) on a curve."""
    return jacobian(lambda x: sensor.h(Motion(x[:3], x[3:6], x[6:], np.zeros(2))))(CURVE)


def is_turning(slope: np.ndarray) -> bool:
    """Return True for a row that shows the turning alone: a gyro."""
    return not np.any(slope[:TURNING])


def left_inverse(H: np.ndarray, of: list[int]) -> np.ndarray:
    """Return L (3, m) with rows of zeros for the entries of ν that are not given.  (1)"""
    part, L = H[:, of], np.zeros((3, len(H)))
    L[of] = np.linalg.solve(part.T @ part, part.T)
    return L


def arrived(sensor: Any, slot: Slot) -> Any:
    """Return whether a measurement came that is finite."""
    return (slot.has > 0.0) & (np.sum(np.isfinite(slot.z)) == sensor.size)


def replaced(
    reading: Reading, sensor: Any, slot: Slot, nu: np.ndarray, bias: Any = 0.0, scale: Any = 0.0
) -> Any:
    """Return ν (3,) with what the reading shows, less the errors `bias`, `scale`; ν where nothing came.  (1)"""
    came = arrived(sensor, slot)
    z = np.where(came, slot.z[list(reading.rows)], reading.at_rest)
    shown = reading.inverse @ ((z - reading.at_rest - bias) / (1.0 + scale) - reading.slopes @ nu)
    return nu + np.where(came, shown, 0.0)


def age_s(sensor: Any, slot: Slot) -> Any:
    """Return how long before the tick it was measured [s]: by its stamp, its delay and its low-pass."""
    return (
        slot.age_s + (sensor.delay_s if getattr(sensor, "delay_slots", 0) > 0 else 0.0) + low_pass_s(sensor)
    )


def gyro_bias_walk(sensors: Any, readings: tuple[Reading, ...]) -> Any:
    """Return the walk of the bias of the gyro that is read first [rad/s^1.5]; 0 where none is, or none is given."""
    gyros = [getattr(sensors, reading.name) for reading in readings if reading.is_gyro]
    return getattr(gyros[0], "gyro_bias_walk", 0.0) if gyros else 0.0
