"""An inertial measurement unit, nearly horizontal on the vehicle: two accelerometers and the gyro about z.

    f_x = ν̇_x − ν_ψ ν_y − l_x ν_ψ² − l_y ν̇_ψ − g_x      specific force at (l_x, l_y) from the origin      (1)
    f_y = ν̇_y + ν_ψ ν_x − l_y ν_ψ² + l_x ν̇_ψ − g_y      ν: velocity; g_x, g_y: gravity along the floor    (2)
    f_x, f_y ← cos ζ f_x + sin ζ f_y,  cos ζ f_y − sin ζ f_x            turned by ζ to the left
    a_x = cos θ f_x − sin θ g                             roll φ, pitch θ: about x and y of the IMU       (3)
    a_y = sin φ sin θ f_x + cos φ f_y + sin φ cos θ g     (right-handed: positive pitch is nose down)     (4)
    ω_z = cos φ cos θ ν_ψ                                                                                 (5)
    h = scale · (a_x, a_y, ω_z) + bias + slope (T − T₀)   T: temperature, T₀: its reference               (6)

`paper` replaces (3)-(5) by (ν̇_x, ν̇_y, ν_ψ), as Grotz et al., `equ:h` (errata 3): correct only without turning. The
simulation adds, in this order: the walk of the bias b⁺ = b + σ_b √δ n, white noise, the limit of the range, the step of
the converter; sampling.py adds rate, low-pass and delay. n is standard normal, δ the tick. Roll, pitch and bias have
the same effect at rest: a fit finds only their sum, or one of them if the others are fixed. For the floor's slope, cos
α = 1.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from baqueano.errors import Invalid
from baqueano.parameter import INF, document, parameter
from baqueano.sensors.sampling import (
    SensorState,
    check_sensor_fields,
    noise_cov_parameter,
    sample,
    start_state,
)
from baqueano.signals import STANDARD_GRAVITY, Motion, Slot
from baqueano.vehicles.drivetrain import quantise

MODELS = ("physical", "paper")
# ±, of the scales of an MPU-6050 without calibration (PS-MPU-6000A rev 3.4, 6.1 and 6.2)
SCALE_TOLERANCE = 0.03


@document
@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """Sensor of z = (a_x, a_y, ω_z) [m/s², m/s², rad/s], sensor frame: two accelerometers, gyro about z.

    Parameters
    ----------
    measurement_model : str
        "physical", or "paper": the equation of Grotz et al., correct for a vehicle that does not turn.
    delay_slots : int
        Number of past ticks that are stored for the delay: delay_s · rate of the loop, rounded up; not traced.
    has_low_pass : bool
        True if low_pass_hz is finite; set automatically; not traced.

    References
    ----------
    Grotz et al., `equ:h` (errata 3): equations (1)-(6) of the module.

    Examples
    --------
    >>> imu = Imu(gyro_bias=0.01)
    >>> print(imu.h(Motion(np.zeros(3), np.array([0.5, 0.0, 1.0]), np.zeros(3), np.zeros(2))))
    [0.   0.5  1.01]
    """

    reads: ClassVar[str] = "imu"
    size: ClassVar[int] = 3
    noise_size: ClassVar[int] = 6  # standard normals per tick: three of white noise, three of the bias walk
    usual_std: ClassVar[tuple[float, ...]] = (0.1, 0.1, 0.005)  # of a low-cost chip on a vehicle in motion

    measurement_model: str = "physical"
    delay_slots: int = 0
    has_low_pass: bool = False
    rate_hz: float = parameter("Hz", "measurements per second", low=1e-3, high=1e5, default=100.0)
    accel_bias: np.ndarray = parameter(
        "m/s²", "bias of the accelerometers", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,),
        symbol=("b_{a,x}", "b_{a,y}"), std="accel_bias_std", walk="accel_bias_walk",
    )  # fmt: skip
    gyro_bias: float = parameter(
        "rad/s", "bias of the gyro", low=-10.0, high=10.0, default=0.0, symbol=r"b_{\omega}",
        std="gyro_bias_std", walk="gyro_bias_walk",
    )  # fmt: skip
    accel_bias_walk: float = parameter(
        "m/s²/√s", "random walk of the accelerometers' bias in 1 s", low=0.0, high=100.0, default=0.0
    )
    gyro_bias_walk: float = parameter(
        "rad/s/√s", "random walk of the gyro's bias in 1 s", low=0.0, high=10.0, default=0.0
    )
    accel_noise_std: np.ndarray = parameter(
        "m/s²", "white noise of an acceleration", low=0.0, high=1e3, default=(0.0, 0.0), shape=(2,)
    )
    gyro_noise_std: float = parameter("rad/s", "white noise of the gyro", low=0.0, high=100.0, default=0.0)
    accel_scale: np.ndarray = parameter(
        "1", "scale of the accelerometers", low=0.1, high=10.0, default=(1.0, 1.0), shape=(2,), role="scale",
        shown_by="a known slope, or a speed from wheels or a camera", symbol=("s_{a,x}", "s_{a,y}"),
    )  # fmt: skip
    gyro_scale: float = parameter(
        "1", "scale of the gyro", low=0.1, high=10.0, default=1.0, role="scale",
        shown_by='turns whose angle is known: turn it twice on its mark, and add --measured "end: 720 deg"',
        measured_by="two turns on its mark, measured by hand", symbol=r"s_{\omega}", std="gyro_scale_std",
    )  # fmt: skip
    lever_arm_m: np.ndarray = parameter(
        "m", "position of the IMU in the body", low=-100.0, high=100.0, default=(0.0, 0.0), shape=(2,),
        shown_by=("turning fast", "sudden changes of yaw rate"), measured_by="the tape",
        symbol=("r_{x}", "r_{y}"),
    )  # fmt: skip
    tilt_rad: np.ndarray = parameter(
        "rad", "roll and pitch of the IMU on the vehicle", low=-1.5, high=1.5, default=(0.0, 0.0),
        shape=(2,),
        shown_by="a known bias: fix accel_bias at the mean of two rests, with the vehicle turned around between them",
        measured_by="a level", symbol=(r"\theta_{x}", r"\theta_{y}"),
    )  # fmt: skip
    heading_rad: float = parameter(
        "rad", "turn of the IMU on the vehicle, to the left", low=-3.2, high=3.2, default=0.0, role="mount",
        shown_by="sudden starts and stops in a straight line", symbol=r"\psi_{s}",
    )  # fmt: skip
    accel_limit: float = parameter("m/s²", "full-scale range of the accelerometers", low=1e-3, default=INF)
    gyro_limit: float = parameter("rad/s", "full-scale range of the gyro", low=1e-3, default=INF)
    accel_step: float = parameter(
        "m/s²", "quantization step of the converter; 0 for none", low=0.0, high=10.0, default=0.0
    )
    gyro_step: float = parameter(
        "rad/s", "quantization step of the converter; 0 for none", low=0.0, high=1.0, default=0.0
    )
    temperature_c: float = parameter("°C", "temperature of the chip", low=-100.0, high=200.0, default=25.0)
    temperature_reference_c: float = parameter(
        "°C", "temperature at which the biases are valid", low=-100.0, high=200.0, default=25.0
    )
    accel_temperature_slope: np.ndarray = parameter(
        "m/s² per °C", "change of the bias", low=-1.0, high=1.0, default=(0.0, 0.0), shape=(2,)
    )
    gyro_temperature_slope: float = parameter(
        "rad/s per °C", "change of the bias", low=-1.0, high=1.0, default=0.0
    )
    delay_s: float = parameter("s", "age of the signal that is read", low=0.0, high=2.0, default=0.0)
    low_pass_hz: float = parameter(
        "Hz", "bandwidth of the filter in the chip, by its setting or data sheet", low=0.1, default=INF
    )
    accel_bias_std: np.ndarray = parameter(
        "m/s²", "standard deviation of accel_bias after it is switched on", low=0.0, high=100.0, default=(0.05, 0.05),
        shape=(2,), role="noise",
    )  # fmt: skip
    gyro_bias_std: float = parameter(
        "rad/s", "standard deviation of gyro_bias after it is switched on", low=0.0, high=10.0, default=0.002,
        role="noise",
    )  # fmt: skip
    gyro_scale_std: float = parameter(
        "1", "standard deviation of gyro_scale: 0.03 by the data sheet, 0.01 after two turns on its mark",
        low=0.0, high=1.0, default=0.03, role="noise",
    )  # fmt: skip
    measurement_noise_cov: np.ndarray | None = noise_cov_parameter("m²/s⁴, rad²/s²", 3)

    def __post_init__(self) -> None:
        if self.measurement_model not in MODELS:
            raise Invalid.of("imu.model", value=repr(self.measurement_model), valid=MODELS)
        check_sensor_fields(self)
        if self.low_pass_hz < INF:
            object.__setattr__(self, "has_low_pass", True)

    @property
    def cov(self) -> np.ndarray:
        """Return Q (3, 3), the covariance of one measurement."""
        if self.measurement_noise_cov is not None:
            return self.measurement_noise_cov
        return np.diag(self._channels(self.accel_noise_std, self.gyro_noise_std) ** 2)

    @property
    def limit(self) -> np.ndarray:
        """Return the largest absolute reading (3,) of each channel [m/s², m/s², rad/s]."""
        return self._channels(self.accel_limit * np.ones(2), self.gyro_limit)

    def h(self, motion: Motion) -> np.ndarray:
        """Return the measurement (a_x, a_y, ω_z) (3,) without noise.  (6)"""
        if self.measurement_model == "paper":
            ideal = np.array([motion.nu_dot[0], motion.nu_dot[1], motion.nu[2]])
        else:
            ideal = self._specific_force(motion)
        warm = self.temperature_c - self.temperature_reference_c
        bias = self._channels(
            self.accel_bias + self.accel_temperature_slope * warm,
            self.gyro_bias + self.gyro_temperature_slope * warm,
        )
        return self._channels(self.accel_scale, self.gyro_scale) * ideal + bias

    def init(self) -> SensorState:
        """Return the state of an IMU before its first tick."""
        return start_state(self)

    def step(
        self, state: SensorState, motion: Motion, dt_s: float, noise: np.ndarray
    ) -> tuple[SensorState, Slot]:
        """Return the state and the reading at the end of a tick; `noise` (6,) is standard normal."""
        state, is_new, z = sample(self, state, motion, dt_s)
        walk = self._channels(self.accel_bias_walk * np.ones(2), self.gyro_bias_walk)
        bias = state.bias + walk * np.sqrt(dt_s) * noise[3:]
        z = z + bias + self._channels(self.accel_noise_std, self.gyro_noise_std) * noise[:3]
        z = quantise(
            np.clip(z, -self.limit, self.limit), self._channels(self.accel_step * np.ones(2), self.gyro_step)
        )
        return state._replace(bias=bias), Slot(is_new, np.where(is_new > 0.0, z, 0.0))

    def _specific_force(self, motion: Motion) -> np.ndarray:
        """Return (a_x, a_y, ω_z) (3,) of an IMU without errors, at its position and with its angles.  (1)-(5)"""
        nu, nu_dot, g = motion.nu, motion.nu_dot, motion.gravity
        lx, ly = self.lever_arm_m
        f_x = nu_dot[0] - nu[2] * nu[1] - lx * nu[2] * nu[2] - ly * nu_dot[2] - g[0]
        f_y = nu_dot[1] + nu[2] * nu[0] - ly * nu[2] * nu[2] + lx * nu_dot[2] - g[1]
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        f_x, f_y = cos * f_x + sin * f_y, cos * f_y - sin * f_x
        phi, theta = self.tilt_rad
        a_x = np.cos(theta) * f_x - np.sin(theta) * STANDARD_GRAVITY
        a_y = np.sin(phi) * np.sin(theta) * f_x + np.cos(phi) * f_y
        a_y = a_y + np.sin(phi) * np.cos(theta) * STANDARD_GRAVITY
        return np.array([a_x, a_y, np.cos(phi) * np.cos(theta) * nu[2]])

    @staticmethod
    def _channels(accel: np.ndarray, gyro: float) -> np.ndarray:
        """Return one array (3,) of the values for two accelerometers (2,) and the gyro."""
        return np.array([accel[0], accel[1], gyro])
