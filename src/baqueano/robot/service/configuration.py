"""Derive, from a vehicle file, the configuration of the firmware and the `Body` for the world."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from baqueano.robot.uno.frames import MAX_PWM_HZ, Config, Driver, Info
from baqueano.worlds.applied_duty import AppliedMotors, MotorCharacteristic
from baqueano.worlds.robot import Body

if TYPE_CHECKING:
    from baqueano.robot.uno.link import Uno
    from baqueano.vehicle_file.file import VehicleFile
    from baqueano.vehicle_file.head import Hardware


def configure_body(vehicle_file: "VehicleFile", uno: "Uno", wait: Callable[[float], object]) -> Body:
    """Configure the Uno for a drive, read the settings of its motors, and return the `Body` of the vehicle.
    `wait` receives the times [s] to wait for answers.
    """
    config = firmware_config(vehicle_file.robot, uno.info)
    uno.configure(config, wait)
    wheel_curves = [
        MotorCharacteristic(1e-3 * w.dead_zone_permille, 1e-3 * w.slope_permille)
        for w in uno.settings(wait).curves
    ]
    return Body(
        getattr(vehicle_file.vehicle.drivetrain, "mixing", "none"), vehicle_file.geometry.wheel_radius_m,
        vehicle_file.robot.counts_per_turn,
        AppliedMotors(float(config.slew_permille_per_ms), tuple(wheel_curves)),
    )  # fmt: skip


def firmware_config(hardware: "Hardware", info: Info | None) -> Config:
    """Return the firmware's configuration that [robot] requires; `info` contains the bridge, which limits the PWM."""
    max_hz = MAX_PWM_HZ[Driver(info.driver)] if info is not None else min(MAX_PWM_HZ.values())
    return Config(
        dead_man_ms=round(1e3 * hardware.dead_man_s),
        telemetry_ms=max(5, round(1e3 / hardware.telemetry_hz)),
        slew_permille_per_ms=min(1000, max(1, round(hardware.slew_per_s))),
        pwm_hz=round(min(hardware.pwm_hz, max_hz)),
        least_battery_mv=round(1e3 * hardware.least_battery_v),
    )
