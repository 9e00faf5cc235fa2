"""Drives of the onboard service on the emulated robot, with actions during the drive."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason, stop
from baqueano.door.operator import Operator
from baqueano.door.states import DoorState
from baqueano.drive.mission import Mission, pack
from baqueano.robot.service.imu_upkeep import ImuUpkeep
from baqueano.robot.service.service import Service
from baqueano.runs import read_run
from tests.emulated.robot import EmulatedRobot

TEACHER = stop(StopReason.STOPPED_BY, words="the teacher stopped it")


def serve(robot: EmulatedRobot, file: Any, folder: Path) -> Any:
    """Return a service on this robot that has examined its hardware; its messages are in `messages`."""
    messages: list[dict[str, Any]] = []
    service: Any = Service(
        robot.uno, ImuUpkeep(robot.imu), file.robot, folder, Operator(lambda: robot.now_ns), messages.append,
        now_ns=lambda: robot.now_ns, sleep=robot.wait,
    )  # fmt: skip
    service.messages = messages
    look_around(service, robot, 5)
    return service


def look_around(service: Any, robot: EmulatedRobot, times: int) -> None:
    """Let the service examine its hardware, as it does while idle."""
    for _ in range(times):
        service.idle()
        robot.wait(0.05)


def spin(seconds: float = 1.0, turn: float = 0.6, file: Any = None) -> Mission:
    """Return the text of a mission that turns in place."""
    file = file or vehicle_file.load("small")
    u = np.tile([0.0, 0.0, turn], (round(seconds * file.rate_hz), 1))
    return pack(Mission("experiment", u=u), file)


def drive(service: Any, mission: Mission | str, attended: bool = False) -> tuple[dict[str, Any], Any]:
    """Perform the mission; return its end message and its run."""
    service.execute_request(mission, attended=attended)
    end = [m for m in service.messages if m["type"] == "done"][-1]
    return end, None if end["run"] is None else read_run(service.folder / end["run"])


def during(service: Any, robot: EmulatedRobot, after_s: float, act: Callable[[], Any]) -> None:
    """Call `act` once, at this time after the start of the drive."""
    start: list[int] = []

    def healthy() -> None:
        if service.machine.state in (DoorState.MISSION, DoorState.MANUAL):
            start.append(robot.now_ns)
            if robot.now_ns - start[0] >= after_s * 1e9 and not service.acted:
                service.acted = True
                act()

    service.acted, service.notify_watchdog = False, healthy
