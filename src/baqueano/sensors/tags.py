"""Tags on the floor at known positions: QR codes, RFID tags, crossings of two tapes. A reader passes over them.

    h = p + R(ψ) l             position of the reader: body's origin p, heading ψ, lever arm l             (1)
    Q = σ² I, or (σ² + ¼ r²) I without the offset         σ: noise_std, r: radius_m                       (2)
    z = h + pᵢ − pⱼ            if the tag j is mistaken for the tag i                                     (3)

The reader reports once for each tag that it passes within `radius_m`, at the tick in which the tag is nearest. A camera
over a QR code measures the offset from the tag. A reader without an offset (`measures_offset = false`) reports the
position of the tag; its error is uniform in a disc, with variance ¼ r² along each axis. An estimator can test for (3),
because the shift is known. One reader can read any number of tags. Two tags limit the errors of position and heading,
one tag only the error of the position.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from baqueano.contracts.values import Value
from baqueano.errors import Invalid
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import noise_cov_parameter, sensor_position
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds

ABEAM_TOLERANCE = 1e-9  # fraction of the squared distance in a tick: tolerance for rounding


class TagsState(NamedTuple):
    """State of a tag reader between two ticks."""

    previous_position: np.ndarray  # (2,) position of the reader at the previous tick [m]
    ready: Value  # 1.0 after the reader was outside the radius of all tags, until it reads one


@document
@dataclass(frozen=True, slots=True, eq=False)
class Tags:
    """Sensor of z = (x, y) [m], map frame, at the moments when the vehicle passes a tag on the floor.

    Parameters
    ----------
    measures_offset : bool
        True if the reader measures its offset from the tag.

    Examples
    --------
    >>> reader = Tags(points_m=np.array([[0.5, 0.0], [1.0, 0.5]]))
    >>> print(reader.h(Motion(np.array([0.5, 0.01, 0.0]), np.zeros(3), np.zeros(3), np.zeros(2))))
    [0.5  0.01]
    """

    size: ClassVar[int] = 2
    noise_size: ClassVar[int] = 2  # standard normals per tick
    rate_hz: ClassVar[float] = INF  # the sensor measures whenever a tag is passed
    delay_s: ClassVar[float] = 0.0

    points_m: np.ndarray = parameter(
        "m", "positions of the tags in the map, one row each", low=-1e4, high=1e4, shape=None, role="fixed"
    )
    radius_m: float = parameter(
        "m", "lateral distance within which a tag is read", low=1e-4, high=100.0, default=0.05
    )
    measures_offset: bool = True
    noise_std: float = parameter("m", "white noise of each number", low=0.0, high=100.0, default=0.005)
    lever_arm_m: np.ndarray = parameter(
        "m", "position of the reader in the body, l", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,),
        measured_by="the tape",
    )  # fmt: skip
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²", 2)

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.points_m.ndim != 2 or self.points_m.shape[1] != 2:
            raise Invalid.of("tags.points", value=str(self.points_m.shape))

    @property
    def cov(self) -> np.ndarray:
        """Return Q (2, 2), the covariance of one measurement.  (2)"""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        offset_variance = 0.0 if self.measures_offset else 0.25 * self.radius_m**2
        return np.eye(2) * (self.noise_std**2 + offset_variance)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the position (2,) [m] of the reader in the map.  (1)"""
        return sensor_position(self.lever_arm_m, motion)

    def mistakes(self, z: np.ndarray) -> np.ndarray:
        """Return the vectors (n, 2) from the tag nearest to z to each tag: corrections for a mistaken tag.  (3)"""
        squared_distances = np.sum((self.points_m - z) ** 2, axis=1)
        is_nearest = np.where(squared_distances <= np.min(squared_distances), 1.0, 0.0)
        return self.points_m - is_nearest @ self.points_m / np.sum(is_nearest)

    def init(self) -> TagsState:
        """Return the state before the first tick; a reader that starts over a tag does not read that tag."""
        return TagsState(np.zeros(2), 0.0)

    def step(
        self, state: TagsState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[TagsState, Slot]:
        """Return the state, and the position (2,) [m] of the reader, or of the tag, if a tag was passed in this tick.

        `noise` (2,) is standard normal.
        """
        position = self.h(motion)
        # (n, 2)
        displacement = position - state.previous_position
        previous_offsets = state.previous_position - self.points_m
        offsets = position - self.points_m
        # lateral distance times the length of the displacement
        cross_product = np.abs(
            previous_offsets[:, 0] * displacement[1] - previous_offsets[:, 1] * displacement[0]
        )
        is_passed = (previous_offsets @ displacement < 0.0) & (
            offsets @ displacement >= -ABEAM_TOLERANCE * (displacement @ displacement)
        )
        is_hit = is_passed & (cross_product <= self.radius_m * np.hypot(*displacement))
        reading_mask = np.where(is_hit & (state.ready > 0.0), 1.0, 0.0)
        is_new: Value = np.max(reading_mask)
        is_away = np.min(np.sum(offsets**2, axis=1)) > self.radius_m**2
        ready = np.where(is_away, 1.0, np.where(is_new > 0.0, 0.0, state.ready))
        measurement = (
            position
            if self.measures_offset
            else reading_mask @ self.points_m / np.maximum(np.sum(reading_mask), 1.0)
        )
        return TagsState(position, ready), Slot(
            is_new, np.where(is_new > 0.0, measurement + self.noise_std * noise, 0.0)
        )
