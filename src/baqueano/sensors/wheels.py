"""Sensors of the speed of the wheels, for a vehicle with encoders. The vehicle of the paper does not have them.

    wheels      v_l = s_l (ν_x − ν_ψ b/2),   v_r = s_r (ν_x + ν_ψ b/2)        b the track                 (1)
    odometer    v = s ν_x                                                                                 (2)

ν_x is the speed, ν_ψ the yaw rate, s the scale: a wheel smaller than its nominal size turns faster and measures more.
On a floor s is not constant, because wheels slip and their radius depends on the load. The variable part of s has the
standard deviation `slip_std` and decays with the time constant `slip_fade_s`.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from baqueano.contracts.values import Tree
from baqueano.parameter import document, parameter
from baqueano.sensors.sampling import SampledSensor, noise_cov_parameter
from baqueano.signals import Motion

SLIP_STD, SLIP_FADE_S = 0.02, 0.5  # of a small wheel with moderate acceleration on a hard floor


def track_parameter() -> Any:
    """Return the parameter b [m], the distance between two wheels."""
    return parameter(
        "m", "distance from the left to the right wheel, b", low=1e-3, high=100.0, measured_by="the tape",
        shown_by="turns whose angle is known", symbol="b_{t}",
    )  # fmt: skip


def radii_parameter() -> Any:
    """Return the parameter (s_l, s_r) (2,), the scales of the left and the right wheel."""
    return parameter(
        "1", "scale of the left and the right wheel", low=0.1, high=10.0, default=(1.0, 1.0), shape=(2,),
        role="scale", shown_by="a distance that is known, by tape or camera", symbol="s_{r}", std="radius_scale_std",
        slip="slip_std", fade="slip_fade_s",
    )  # fmt: skip


def scale_std_parameter() -> Any:
    """Return the parameter for the standard deviation of the scale of a wheel or odometer."""
    return parameter("1", "standard deviation of a scale", low=0.0, high=1.0, default=0.01, role="noise")


def slip_parameter() -> Any:
    """Return the parameter for the slip of a wheel: the standard deviation of the variable part of its scale."""
    return parameter(
        "1", (
            "fraction by which a wheel slips, rms: its variable part"
        ), low=0.0, high=1.0, default=SLIP_STD, role="noise"
    )  # fmt: skip


def slip_fade_parameter() -> Any:
    """Return the parameter for the time constant [s] with which the slip decays."""
    return parameter(
        "s",
        ("time constant with which the slip decays"),
        low=1e-3,
        high=1e3,
        default=SLIP_FADE_S,
        role="noise",
    )


@document
@dataclass(frozen=True, slots=True, eq=False)
class Wheels(SampledSensor):
    """Sensor of z = (v_l, v_r) [m/s], the speeds at which the left and the right wheel roll.

    Examples
    --------
    >>> wheels = Wheels(track_m=0.12)
    >>> print(wheels.h(Motion(np.zeros(3), np.array([0.2, 0.0, 1.0]), np.zeros(3), np.zeros(2))))
    [0.14 0.26]
    """

    reads: ClassVar[str] = "wheels"
    usual_std: ClassVar[tuple[float, ...]] = (0.01, 0.01)

    size: ClassVar[int] = 2

    track_m: float = track_parameter()
    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=100.0)
    radius_scale: np.ndarray = radii_parameter()
    noise_std: float = parameter("m/s", "white noise of a wheel", low=0.0, high=100.0, default=0.0)
    delay_s: float = parameter("s", "age of the signal that is read", low=0.0, high=2.0, default=0.0)
    radius_scale_std: float = scale_std_parameter()
    slip_std: float = slip_parameter()
    slip_fade_s: float = slip_fade_parameter()
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²/s²", 2)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the speeds of the wheels (2,) [m/s] without noise.  (1)"""
        return rolling_speeds(self, motion)


@document
@dataclass(frozen=True, slots=True, eq=False)
class Odometer(SampledSensor):
    """Sensor of z = (v,) [m/s], the forward speed.

    Examples
    --------
    >>> odometer = Odometer(scale=1.1)
    >>> print(odometer.h(Motion(np.zeros(3), np.array([0.2, 0.0, 1.0]), np.zeros(3), np.zeros(2))).round(2))
    [0.22]
    """

    reads: ClassVar[str] = "odometer"
    usual_std: ClassVar[tuple[float, ...]] = (0.01,)

    size: ClassVar[int] = 1

    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=100.0)
    scale: float = parameter(
        "1", "reading per metre", low=0.1, high=10.0, default=1.0, role="scale",
        shown_by="a distance that is known, by tape or camera", symbol="s_{v}", std="scale_std",
        slip="slip_std", fade="slip_fade_s",
    )  # fmt: skip
    noise_std: float = parameter("m/s", "white noise of the speed", low=0.0, high=100.0, default=0.0)
    delay_s: float = parameter("s", "age of the signal that is read", low=0.0, high=2.0, default=0.0)
    scale_std: float = scale_std_parameter()
    slip_std: float = slip_parameter()
    slip_fade_s: float = slip_fade_parameter()
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²/s²", 1)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the forward speed (1,) [m/s] without noise.  (2)"""
        return np.array([self.scale * motion.nu[0]])


def rolling_speeds(sensor: Tree, motion: Motion) -> np.ndarray:
    """Return the speeds (2,) [m/s] that wheels with `track_m` and `radius_scale` measure.  (1)"""
    turning_speed = 0.5 * sensor.track_m * motion.nu[2]
    return sensor.radius_scale * np.array([motion.nu[0] - turning_speed, motion.nu[0] + turning_speed])
