"""Give a command the hardware for itself: on this machine, while the service is stopped, or over ssh on another."""

import json
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

from baqueano.diagnostics import fault
from baqueano.door.remote_session import answer_of, attended
from baqueano.door.ssh import ssh
from baqueano.door.states import DoorState
from baqueano.errors import INTERRUPTED, AnswerNo, RobotUnreachable, UsageError, of_code
from baqueano.language import VARIABLE, current
from baqueano.language import translated as _
from baqueano.printable import words
from baqueano.robot import SERVICE
from baqueano.robot.uno.serial_port import connected
from baqueano.robot.workshop.floor_tests import FloorTests

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow
    from baqueano.vehicle_file.head import Hardware

Say = Callable[[str], object]


@contextmanager
def service_off(say: Say) -> Iterator[None]:
    """Stop the service meanwhile, if it runs. AnswerNo while it drives, UsageError if it may not be stopped."""
    if not shutil.which("systemctl") or _quiet(["systemctl", "--quiet", "is-active", SERVICE]).returncode:
        yield
        return
    _not_driving()
    sudo = ["sudo", "-n"] if shutil.which("sudo") else []
    process = _quiet([*sudo, "systemctl", "stop", SERVICE])
    if process.returncode:
        raise UsageError(
            fault("hardware.service-has-it", f"sudo systemctl stop {SERVICE}", error=process.stderr.strip())
        )
    say(_("{service} stopped meanwhile", service=SERVICE))
    try:
        yield
    finally:
        process = _quiet([*sudo, "systemctl", "start", SERVICE])
        say(
            _(
                "{service} was not started again ({error}). Type: sudo systemctl start {service}",
                service=SERVICE,
                error=process.stderr.strip(),
            )
            if process.returncode
            else _("{service} started again", service=SERVICE)
        )


@contextmanager
def opened(
    hardware: "Hardware", say: Say, in_chip_axes: bool = False, motors: bool = True
) -> Iterator[FloorTests]:
    """Open Uno and IMU of [robot] until the operator disconnects: then KeyboardInterrupt.

    Without `motors` the Uno may be missing.
    """
    from baqueano.robot.imu import driver as imu_driver

    with ExitStack() as things:
        things.enter_context(service_off(say))
        things.enter_context(attended(say))
        uno = things.enter_context(connected(hardware.port)) if motors else None
        imu = imu_driver.of(hardware, say, in_chip_axes)
        things.callback(imu.close)
        yield FloorTests(uno, imu)


def _not_driving() -> None:
    """Raise AnswerNo if the service drives. If it does not answer, it does not drive, or its watchdog ends it."""
    from baqueano.door.remote import reached

    with suppress(RobotUnreachable), reached("here") as remote:
        state = remote.state["state"]
        if state in (DoorState.MANUAL, DoorState.MISSION):
            raise AnswerNo(fault("hardware.drives", state=state))


def rows_from_host(host: str, *verb: str) -> list["TableRow"]:
    """Return the rows that `baqueano VERB --json` answers at HOST; its messages to the operator are shown at once.

    Raises the error that was raised there, KeyboardInterrupt if it was interrupted, RobotUnreachable without a
    connection.
    """
    answer, code = answer_of(ssh(host, shlex.join([*_language_setting(), "baqueano", *verb, "--json"])))
    try:
        rows = words(json.loads(answer)["rows"])
        if isinstance(rows, list) and all(isinstance(row, dict) for row in rows):
            return rows
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    cause = {
        127: _("{host} lacks baqueano. Type: baqueano robot setup {host}", host=host),
        255: _("{host} was not reached by ssh. To see why: ssh {host}", host=host),
    }.get(
        code, _("{host}: baqueano {verb} ended there, for the reason above.", host=host, verb=" ".join(verb))
    )
    raise of_code(code, cause, otherwise=RobotUnreachable)


def _language_setting() -> list[str]:
    """Return the command words that make the vehicle answer in the current language."""
    return [] if current() == "en" else ["env", f"{VARIABLE}={current()}"]


def _quiet(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
