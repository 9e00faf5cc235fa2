"""Sensors of the wheels' speed, for a vehicle with encoders; the paper's has none.

    wheels      v_l = s_l (ν_x − ν_ψ b/2),   v_r = s_r (ν_x + ν_ψ b/2)        b the track                 (1)
    odometer    v = s ν_x                                                                                 (2)

s is the scale: a wheel that is smaller than believed turns faster and reads more. Slip is not in here.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.parameter import parameter
from baqueano.sensors.sampling import SensorState, sample, start
from baqueano.signals import Motion, Slot
from baqueano.vehicles.bounds import check_bounds
from baqueano.vehicles.delay import check_delay


@dataclass(frozen=True, slots=True, eq=False)
class Wheels:
    """z = (v_l, v_r) [m/s], the speed at which the left and the right wheel roll.

    Configuration, never traced: `delay_slots`, past ticks kept for the delay (delay_s · rate of the loop,
    rounded up).
    """

    track_m: float = parameter(
        "m", "from the left wheel to the right one, b", low=1e-3, high=100.0, measured_by="the tape",
        shown_by="turns whose angle is known", symbol="b_{t}",
    )  # fmt: skip
    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements a second", low=1e-3, high=1e5, default=100.0)
    radius_scale: np.ndarray = parameter(
        "1", "scale of the left and the right wheel", low=0.1, high=10.0, default=(1.0, 1.0), shape=(2,),
        role="scale", shown_by="a distance that is known, by tape or camera", symbol="s_{r}", std="radius_scale_std",
    )  # fmt: skip
    noise_std: float = parameter("m/s", "white noise of a wheel", low=0.0, high=100.0, default=0.0)
    delay_s: float = parameter("s", "age of the signal that is read", low=0.0, high=2.0, default=0.0)
    radius_scale_std: float = parameter(
        "1", "how well each radius_scale is known", low=0.0, high=1.0, default=0.01, role="noise"
    )
    measurement_noise_cov: np.ndarray | None = parameter(
        "m²/s²", "covariance Q to believe in; left out: from the noise", default=None, shape=(2, 2)
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        check_delay("Wheels", self.delay_s, self.delay_slots)

    @property
    def size(self) -> int:
        """m."""
        return 2

    @property
    def noise_size(self) -> int:
        """Unit normals a tick."""
        return 2

    @property
    def cov(self) -> np.ndarray:
        """Q (2, 2): the covariance of one measurement."""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        return np.eye(2) * self.noise_std**2

    def h(self, motion: Motion) -> np.ndarray:
        """The noise-free measurement (2,).  (1)"""
        across = 0.5 * self.track_m * motion.nu[2]
        return self.radius_scale * np.array([motion.nu[0] - across, motion.nu[0] + across])

    def init(self) -> SensorState:
        """Encoders just switched on."""
        return start(self)

    def step(
        self, state: SensorState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[SensorState, Slot]:
        """What the wheels say at the end of a tick; `noise` (2,) are unit normals."""
        state, has, z = sample(self, state, motion, dt_s)
        return state, Slot(has, np.where(has > 0.0, z + self.noise_std * noise, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Odometer:
    """z = (v,) [m/s], the forward speed.

    Configuration, never traced: `delay_slots`, past ticks kept for the delay (delay_s · rate of the loop,
    rounded up).
    """

    delay_slots: int = 0
    rate_hz: float = parameter("Hz", "measurements a second", low=1e-3, high=1e5, default=100.0)
    scale: float = parameter(
        "1", "what it reads per metre", low=0.1, high=10.0, default=1.0, role="scale",
        shown_by="a distance that is known, by tape or camera", symbol="s_{v}", std="scale_std",
    )  # fmt: skip
    noise_std: float = parameter("m/s", "white noise of the speed", low=0.0, high=100.0, default=0.0)
    delay_s: float = parameter("s", "age of the signal that is read", low=0.0, high=2.0, default=0.0)
    scale_std: float = parameter(
        "1", "how well scale is known", low=0.0, high=1.0, default=0.01, role="noise"
    )
    measurement_noise_cov: np.ndarray | None = parameter(
        "m²/s²", "covariance Q to believe in; left out: from the noise", default=None, shape=(1, 1)
    )

    def __post_init__(self) -> None:
        check_bounds(self)
        check_delay("Odometer", self.delay_s, self.delay_slots)

    @property
    def size(self) -> int:
        """m."""
        return 1

    @property
    def noise_size(self) -> int:
        """Unit normals a tick."""
        return 1

    @property
    def cov(self) -> np.ndarray:
        """Q (1, 1): the covariance of one measurement."""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        return np.eye(1) * self.noise_std**2

    def h(self, motion: Motion) -> np.ndarray:
        """The noise-free measurement (1,).  (2)"""
        return np.array([self.scale * motion.nu[0]])

    def init(self) -> SensorState:
        """An odometer just switched on."""
        return start(self)

    def step(
        self, state: SensorState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[SensorState, Slot]:
        """What the odometer says at the end of a tick; `noise` (1,) is a unit normal."""
        state, has, z = sample(self, state, motion, dt_s)
        return state, Slot(has, np.where(has > 0.0, z + self.noise_std * noise, 0.0))
