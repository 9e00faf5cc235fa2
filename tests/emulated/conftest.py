"""The fixtures of the emulated tests, and the Debian packages that each fixture needs.

A test is skipped by name if a package is missing; it fails instead if the variable CI is set.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from baqueano import vehicle_file
from baqueano.robot.service.service import Service
from tests.emulated import rig
from tests.emulated.drives import serve
from tests.emulated.realtime import OnPty, on_pty
from tests.emulated.robot import EmulatedRobot
from tests.emulated.uno import EmulatedUno


def programs(**packages: str) -> Callable[[], list[str]]:
    """Return the packages of those programs that are not installed."""
    return lambda: [package for name, package in packages.items() if not shutil.which(name.replace("_", "-"))]


NEEDS = {  # fixture: its missing packages
    "firmware": rig.missing,
    "new_uno": rig.missing,
    "uno": rig.missing,
    "arduino_core": lambda: [] if ARDUINO_CORE.exists() else ["arduino-core-avr"],
    "host_firmware": programs(gcc="gcc"),
    "optiboot": lambda: (
        rig.missing() + programs(avrdude="avrdude")() + ([] if OPTIBOOT.exists() else ["arduino-core-avr"])
    ),
}
ARDUINO_CORE = Path("/usr/share/arduino/hardware/arduino/avr/cores/arduino/main.cpp")
OPTIBOOT = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders/optiboot/optiboot_atmega328.hex")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if os.environ.get("CI"):
        return
    lacking = {fixture: missing() for fixture, missing in NEEDS.items()}
    for item in items:
        packages = [p for name in getattr(item, "fixturenames", ()) for p in lacking.get(name, ())]
        if packages:
            install = " ".join(dict.fromkeys(packages))
            item.add_marker(pytest.mark.skip(reason=f"{item.name}: sudo apt-get install {install}"))


@pytest.fixture(scope="session")
def firmware(request: pytest.FixtureRequest) -> rig.Built:
    """Return the built firmware and the emulator library."""
    assert not rig.missing(), f"apt-get install {' '.join(rig.missing())}"
    return rig.build(Path(request.config.cache.mkdir("emulated")))


@pytest.fixture
def new_uno(firmware: rig.Built, until_end: Callable[..., EmulatedUno]) -> Callable[..., EmulatedUno]:
    """Return `new_uno(ppm=…)`, which makes an emulated Uno that is freed at the end of the test."""
    return lambda **options: until_end(EmulatedUno(firmware, **options))


@pytest.fixture
def uno(new_uno: Callable[..., EmulatedUno]) -> EmulatedUno:
    """Return an emulated Uno with factory settings: L298N, no encoders, no stored settings."""
    return new_uno()


@pytest.fixture
def new_robot(
    firmware: rig.Built, monkeypatch: pytest.MonkeyPatch, until_end: Callable[..., EmulatedRobot]
) -> Callable[..., EmulatedRobot]:
    """Return `new_robot(file, …)`, which makes a vehicle in lock-step: firmware, drivers and body."""

    def make(file=None, robot_class=EmulatedRobot, wait_s=0.1, **options) -> EmulatedRobot:
        file = file or vehicle_file.load("small")
        robot = until_end(robot_class(firmware, file, patches=monkeypatch, **options))
        robot.wait(wait_s)
        return robot

    return make


@pytest.fixture
def robot(new_robot: Callable[..., EmulatedRobot]) -> EmulatedRobot:
    """Return the small vehicle in lock-step."""
    return new_robot()


@pytest.fixture
def live(firmware: rig.Built) -> Iterator[OnPty]:
    """Return the firmware behind a pty, in real time."""
    with on_pty(firmware) as live:
        yield live


@pytest.fixture
def service(robot: EmulatedRobot, tmp_path: Path) -> Service:
    """Return the onboard service of the robot."""
    return serve(robot, vehicle_file.load("small"), tmp_path)


@pytest.fixture
def optiboot() -> Path:
    """Return the boot-loader of the Uno."""
    assert OPTIBOOT.exists(), "apt-get install arduino-core-avr"
    return OPTIBOOT


@pytest.fixture
def arduino_core() -> Path:
    """Return the sources that the Arduino IDE links to a sketch."""
    assert ARDUINO_CORE.exists(), "apt-get install arduino-core-avr"
    return ARDUINO_CORE.parent
