"""Verbs that need the hardware for themselves: here, while the service lets go of it, or over ssh, there."""

import json
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from baqueano.errors import BaqueanoError, RobotUnreachable, SafetyStop, UsageError
from baqueano.robot.bench import Bench
from baqueano.robot.imu_settings import Settings
from baqueano.robot.serial_port import connected

SERVICE = "baqueano.service"
HOME = "/var/lib/baqueano"
VEHICLE = f"{HOME}/vehicle.toml"
Say = Callable[[str], Any]


@contextmanager
def service_off(say: Say) -> Iterator[None]:
    """The service is stopped meanwhile, where there is one that runs. UsageError where it may not be stopped."""
    if not shutil.which("systemctl") or _quiet(["systemctl", "--quiet", "is-active", SERVICE]).returncode:
        yield
        return
    sudo = ["sudo", "-n"] if shutil.which("sudo") else []
    done = _quiet([*sudo, "systemctl", "stop", SERVICE])
    if done.returncode:
        raise UsageError(
            f"the service has the hardware, and may not be stopped by this user ({done.stderr.strip()}). Type: "
            f"sudo systemctl stop {SERVICE}"
        )
    say(f"{SERVICE} stopped meanwhile")
    try:
        yield
    finally:
        _quiet([*sudo, "systemctl", "start", SERVICE])
        say(f"{SERVICE} started again")


@contextmanager
def opened(hardware: Any, say: Say, in_chip_axes: bool = False, motors: bool = True) -> Iterator[Bench]:
    """Uno and IMU of [robot]. Without `motors` the Uno may be missing."""
    from baqueano.robot import imu as imu_driver

    with ExitStack() as things:
        things.enter_context(service_off(say))
        uno = things.enter_context(connected(hardware.port)) if motors else None
        settings = Settings(
            filter=round(hardware.imu_filter), accel_range_g=round(hardware.imu_accel_range_g),
            gyro_range_dps=round(hardware.imu_gyro_range_dps),
            axes=("x", "y", "z") if in_chip_axes else tuple(hardware.imu_axes),
        )  # fmt: skip
        imu = imu_driver.open(
            round(hardware.imu_bus), address=round(hardware.imu_address), settings=settings, say=say
        )
        things.callback(imu.close)
        yield Bench(uno, imu)


def ssh(host: str, command: str, *options: str) -> list[str]:
    """What runs `command` at HOST, "user@name" or "user@name:port"."""
    name, colon, port = host.rpartition(":")
    where = ["-p", port, name] if colon and port.isdigit() else [host]
    return ["ssh", "-T", "-o", "ConnectTimeout=8", "-o", "ServerAliveInterval=5", *options, *where, command]


def there(host: str, *words: str) -> list[dict[str, Any]]:
    """The rows that `baqueano WORDS --json` answers at HOST; what it says to people is shown as it comes.

    Raises what it raised there, RobotUnreachable where it was not reached.
    """
    done = subprocess.run(
        ssh(host, shlex.join(["baqueano", *words, "--json"])), stdout=subprocess.PIPE, text=True
    )
    try:
        return json.loads(done.stdout)["rows"]
    except (ValueError, KeyError):
        pass
    kinds: dict[int, type[BaqueanoError]] = {2: UsageError, 5: SafetyStop, 1: BaqueanoError}
    why = {
        127: f"{host} has no baqueano. Type: baqueano robot setup {host}",
        255: f"{host} was not reached by ssh. To see why: ssh {host}",
    }
    raise kinds.get(done.returncode, RobotUnreachable)(
        why.get(done.returncode, f"{host}: baqueano {' '.join(words)} ended there, for the reason above.")
    )


def _quiet(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True)
