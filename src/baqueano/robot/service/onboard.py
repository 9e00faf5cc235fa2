"""Implement `baqueano robot run`: open the hardware of a vehicle file, and run the service on it until it is stopped.

An IMU takes a quarter of a second to start. Meanwhile the rest of the program is loaded, which takes longer on a Pi.
"""

import importlib
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from baqueano.errors import BaqueanoError
from baqueano.robot.imu import driver as imu_driver
from baqueano.robot.service.realtime import Systemd, request_realtime
from baqueano.robot.uno.serial_port import open_uno

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

BACKGROUND_MODULES = ("baqueano.robot.service.service", "baqueano.door.sockets")


def serve(
    vehicle_file: "VehicleFile",
    folder: Path,
    path: Path,
    log: Callable[[str], object],
    give_back: Callable[[], object] = lambda: None,
) -> None:
    """Run the service for the vehicle of `vehicle_file` at the socket `path`, with runs in `folder`, until SIGTERM.

    Raise RobotUnreachable if the Uno does not answer. If the IMU does not answer, the service still runs, and reports
    why the vehicle does not drive. Once the IMU answers, the vehicle is READY. A vehicle whose file does not name an
    IMU drives without one. `log` receives lines for the system's log. `give_back` is called when the serial line of the
    Uno is open (serial_port.opened_early).
    """
    systemd = Systemd()
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as hardware:
        try:
            uno = hardware.enter_context(open_uno(vehicle_file.robot.port))
        finally:
            give_back()
        if uno.info is not None:
            log(f"Uno: firmware {uno.info.version_major}.{uno.info.version_minor}, boot {uno.info.boots}")
        load_thread = threading.Thread(
            target=lambda: [importlib.import_module(name) for name in BACKGROUND_MODULES]
        )
        load_thread.start()

        def find_imu() -> Any:
            imu = imu_driver.start_imu(vehicle_file.robot, log)
            hardware.callback(imu.close)
            return imu

        imu, has_imu = None, "imu" in vehicle_file.sensors._fields
        if has_imu:
            with suppress(BaqueanoError):  # the service searches for it again, and reports why it is missing
                imu = find_imu()
        load_thread.join()
        from baqueano.door.operator import Operator
        from baqueano.door.sockets import Door
        from baqueano.robot.service.imu_upkeep import ImuUpkeep
        from baqueano.robot.service.service import Service

        operator = Operator()
        door = Door(path, operator, folder, halt=uno.stop)
        hardware.callback(door.close)
        for line in request_realtime():
            log(line)
        door.frames.begin(vehicle_file, "real")
        imu_upkeep = ImuUpkeep(imu, find_imu if has_imu else None)
        service = Service(
            uno, imu_upkeep, vehicle_file.robot, folder, operator, door.broadcast, door.frames,
            *_watchdog_functions(systemd), log=log,
        )  # fmt: skip
        systemd.notify("READY=1")
        log(f"listens at {path}")
        service.run()
        systemd.notify("STOPPING=1")
        systemd.close()


def _watchdog_functions(systemd: Any) -> tuple[Callable[[], object], Callable[[float], object]]:
    """Return a function that notifies systemd's watchdog, and a function that sets the watchdog's timeout [s].

    If a thread has ended, the watchdog is no longer notified, and systemd starts the service again.
    """
    threads = threading.enumerate()

    def send_heartbeat(text: str = "") -> None:
        if all(thread.is_alive() for thread in threads):
            systemd.notify(f"{text}WATCHDOG=1")

    return send_heartbeat, lambda seconds: send_heartbeat(f"WATCHDOG_USEC={round(1e6 * seconds)}\n")
