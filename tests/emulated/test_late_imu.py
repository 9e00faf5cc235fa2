"""An IMU that does not answer when the service starts: the service looks for it and does not drive without it.

On the real firmware and the real drivers in lock-step.
"""

from functools import partial
from typing import Any

import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.operator import Operator
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, pack
from baqueano.messages import text
from baqueano.robot.imu import driver as imu_driver
from baqueano.robot.imu.settings import ImuSettings
from baqueano.robot.service.imu_upkeep import FIND_PERIOD_S, ImuUpkeep
from baqueano.robot.service.service import FIND_TIMEOUT_S, HANG_TIMEOUT_S, Service
from tests.codes import within
from tests.emulated.drives import drive, look_around, spin


@pytest.fixture
def open_imu(robot):
    """Open the IMU as the service does."""
    return partial(
        imu_driver.open_imu, robot.imu.device.path, settings=ImuSettings(accel_range_g=4), notify=None,
        now_ns=lambda: robot.now_ns, sleep=robot.wait,
    )  # fmt: skip


@pytest.fixture
def service(robot, open_imu, tmp_path):
    """Return a service whose IMU did not answer at the start."""
    messages, texts = [], []
    service: Any = Service(
        robot.uno, ImuUpkeep(find=open_imu), vehicle_file.load("small").robot, tmp_path,
        Operator(lambda: robot.now_ns), messages.append, now_ns=lambda: robot.now_ns, sleep=robot.wait,
        log=texts.append,
    )  # fmt: skip
    service.messages, service.texts = messages, texts
    return service


def test_rt19_a_vehicle_without_its_imu_refuses_to_drive(service, robot):
    chip = robot.bus.devices.pop(0x68)
    look_around(service, robot, 300)
    assert service.machine.state is DoorState.DISARMED
    assert service.machine.reason.code == StopReason.IMU_ABSENT
    assert {cause.code for cause in within(service.machine.reason)} >= {"imu.no-answer"}
    assert [m["reason"] for m in service.messages if m["type"] == "state"][-1] == service.machine.reason
    assert service.texts == [text(service.machine.reason)], "the missing IMU is reported only once"
    for mission in (spin(), pack(Mission("teach"), vehicle_file.load("small"))):
        end, run = drive(service, mission)
        assert end["reason"].figures["cause"].code == StopReason.IMU_ABSENT
        assert run is None
    robot.bus.devices[0x68] = chip


def test_an_imu_that_answers_later_makes_the_vehicle_ready(service, robot):
    chip = robot.bus.devices.pop(0x68)
    look_around(service, robot, 20)
    assert service.machine.state is DoorState.DISARMED
    robot.bus.devices[0x68] = chip
    look_around(service, robot, round((FIND_PERIOD_S + 1.0) * 20))
    assert (service.machine.state, service.machine.reason) == (DoorState.READY, None)
    events = [m["message"] for m in service.messages if m["type"] == "event"]
    assert [event.code for event in events[1:]] == ["imu.answers"]
    assert service.texts == [text(event) for event in events]
    end, run = drive(service, spin())
    assert end["reason"] is None
    assert len(run.sensors["imu"].t_ns) > 90


def test_systemd_waits_for_a_chip_without_samples(service, robot):
    waits, robot.chip.is_frozen = [], True
    service.set_watchdog_timeout = waits.append
    before_ns = robot.now_ns
    service.idle()
    assert (robot.now_ns - before_ns) / 1e9 > HANG_TIMEOUT_S
    assert waits == [FIND_TIMEOUT_S, HANG_TIMEOUT_S]
    assert service.machine.reason.code == StopReason.IMU_ABSENT


def test_a_vehicle_without_an_imu_in_its_file_is_ready(service, robot):
    service.imu.find = None
    look_around(service, robot, 3)
    assert service.machine.state is DoorState.READY
