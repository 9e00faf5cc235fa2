"""An IMU that does not answer when the service starts: nothing drives until it does, and it is looked for.

On the real firmware and the real drivers in lock-step.
"""

from functools import partial
from typing import Any

import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.door.operator import Operator
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, packed
from baqueano.messages import text
from baqueano.robot.imu import driver as imu_driver
from baqueano.robot.imu.settings import ImuSettings
from baqueano.robot.service.service import AGAIN_S, FINDING_S, HANGING_S, Service
from tests.emulated.drives import drive, look_around, spin


@pytest.fixture
def open_imu(robot):
    """Opens its IMU as the service does."""
    return partial(
        imu_driver.open, robot.imu.device.path, settings=ImuSettings(accel_range_g=4), say=None,
        now_ns=lambda: robot.now_ns, sleep=robot.wait,
    )  # fmt: skip


@pytest.fixture
def service(robot, open_imu, tmp_path):
    """One whose IMU did not answer at the start."""
    messages, texts = [], []
    service: Any = Service(
        robot.uno, None, vehicle_file.load("small").robot, tmp_path, Operator(lambda: robot.now_ns), messages.append,
        now_ns=lambda: robot.now_ns, sleep=robot.wait, say=texts.append, find_imu=open_imu,
    )  # fmt: skip
    service.messages, service.texts = messages, texts
    return service


def test_rt19_a_vehicle_without_its_imu_refuses_to_drive(service, robot):
    chip = robot.bus.devices.pop(0x68)
    look_around(service, robot, 300)
    assert service.machine.state is DoorState.DISARMED
    assert service.machine.reason.code == StopReason.IMU_ABSENT
    assert text(service.machine.reason).startswith("no IMU: No IMU answers at 0x68")
    assert [m["why"] for m in service.messages if m["is"] == "state"][-1] == service.machine.reason
    assert service.texts == [text(service.machine.reason)], "reported once, however often it was looked for"
    for mission in (spin(), packed(Mission("teach"), vehicle_file.load("small"))):
        done, run = drive(service, mission)
        assert "no IMU" in text(done["why"])
        assert run is None
    robot.bus.devices[0x68] = chip


def test_an_imu_that_answers_later_makes_the_vehicle_ready(service, robot):
    chip = robot.bus.devices.pop(0x68)
    look_around(service, robot, 20)
    assert service.machine.state is DoorState.DISARMED
    robot.bus.devices[0x68] = chip
    look_around(service, robot, round((AGAIN_S + 1.0) * 20))
    assert (service.machine.state, service.machine.reason) == (DoorState.READY, None)
    assert service.texts[1:] == ["the IMU answers now"]
    assert service.texts == [text(m["said"]) for m in service.messages if m["is"] == "event"]
    done, run = drive(service, spin())
    assert done["why"] is None
    assert len(run.sensors["imu"].t_ns) > 90


def test_systemd_waits_for_a_chip_without_samples(service, robot):
    waits, robot.chip.frozen = [], True
    service.patience = waits.append
    before_ns = robot.now_ns
    service.idle()
    assert (robot.now_ns - before_ns) / 1e9 > HANGING_S
    assert waits == [FINDING_S, HANGING_S]
    assert service.machine.reason.code == StopReason.IMU_ABSENT


def test_a_vehicle_file_without_an_imu_makes_a_ready_vehicle(service, robot):
    service.find_imu = None
    look_around(service, robot, 3)
    assert service.machine.state is DoorState.READY
