"""Reserve the hardware for one command: on this machine, while the service is stopped, or on another over ssh."""

import json
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar

from baqueano.contracts.values import TableRow
from baqueano.diagnostics import fault
from baqueano.door.remote_session import command_output, interrupt_on_hangup
from baqueano.door.ssh import ssh_command, ssh_line
from baqueano.door.states import DoorState
from baqueano.errors import (
    INTERRUPTED,
    AnswerNo,
    BaqueanoError,
    RobotUnreachable,
    UsageError,
    exit_code_error,
)
from baqueano.messages.language import LANGUAGE_VARIABLE, current_language, translate as _
from baqueano.messages.printable import baqueano_command, printable_json
from baqueano.robot import SERVICE, VEHICLE
from baqueano.robot.uno.serial_port import open_uno
from baqueano.robot.workshop.floor_tests import FloorTests

if TYPE_CHECKING:
    from baqueano.vehicle_file.head import Hardware

Notify = Callable[[str], object]
Result = TypeVar("Result")


@contextmanager
def stopped_service(notify: Notify) -> Iterator[None]:
    """Stop the service if it runs, and start it again after the body.

    Raise AnswerNo during a drive, and UsageError if this user is not allowed to stop the service.
    """
    if (
        not shutil.which("systemctl")
        or _run_quietly(["systemctl", "--quiet", "is-active", SERVICE]).returncode
    ):
        yield
        return
    _check_not_driving()
    sudo = ["sudo", "-n"] if shutil.which("sudo") else []
    process = _run_quietly([*sudo, "systemctl", "stop", SERVICE])
    if process.returncode:
        raise UsageError.of(
            "hardware.used-by-service", f"sudo systemctl stop {SERVICE}", error=process.stderr.strip()
        )
    notify(_("{service} is stopped during these tests", service=SERVICE))
    try:
        yield
    finally:
        process = _run_quietly([*sudo, "systemctl", "start", SERVICE])
        notify(
            _(
                "{service} was not started again ({error}). Type: sudo systemctl start {service}",
                service=SERVICE,
                error=process.stderr.strip(),
            )
            if process.returncode
            else _("{service} started again", service=SERVICE)
        )


@contextmanager
def open_hardware(
    hardware: "Hardware", notify: Notify, in_chip_axes: bool = False, motors: bool = True
) -> Iterator[FloorTests]:
    """Yield the Uno and the IMU of [robot], while the service is stopped.

    Without `motors` the Uno is not opened. Raise KeyboardInterrupt in the body if the operator disconnects.
    """
    from baqueano.robot.imu import driver as imu_driver

    with ExitStack() as resources:
        resources.enter_context(stopped_service(notify))
        resources.enter_context(interrupt_on_hangup(notify))
        uno = resources.enter_context(open_uno(hardware.port)) if motors else None
        imu = imu_driver.start_imu(hardware, notify, in_chip_axes)
        resources.callback(imu.close)
        yield FloorTests(uno, imu)


def _check_not_driving() -> None:
    """Raise AnswerNo if the service executes a drive.

    A service that does not answer is not driving, or its watchdog will end it.
    """
    from baqueano.door.remote import connect

    with suppress(RobotUnreachable), connect("here") as remote:
        state = remote.state["state"]
        if state in (DoorState.MANUAL, DoorState.MISSION):
            raise AnswerNo.of("hardware.drives", state=state)


def fetch_rows(host: str, *verb: str) -> list[TableRow]:
    """Return the rows of `baqueano VERB --json` at HOST; messages to the operator are shown as they arrive.

    Raise the error that was raised at HOST, KeyboardInterrupt if the command was interrupted, or RobotUnreachable
    without a connection.
    """
    output, code = command_output(
        ssh_command(host, shlex.join([*_language_setting(), "baqueano", *verb, "--json"]))
    )
    try:
        rows = printable_json(json.loads(output)["rows"])
        if isinstance(rows, list) and all(isinstance(row, dict) for row in rows):
            return rows
    except (ValueError, KeyError, TypeError, RecursionError):
        pass
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    error_reason = {
        127: fault("ssh.no-baqueano", baqueano_command("robot", "setup", host), host=host),
        255: fault("ssh.not-reached", ssh_line(host), host=host),
    }.get(code, fault("ssh.ended", host=host, verb=" ".join(verb)))
    raise exit_code_error(code, error_reason, default_class=RobotUnreachable)


def fetch_result(make_result: Callable[[list[TableRow]], Result], host: str, *verb: str) -> Result:
    """Return `make_result` of the rows of `baqueano VERB --json` at HOST, for the vehicle file of its service.

    Raise UsageError for rows in another form, as of another version of baqueano. It also
    raises the errors of `fetch_rows`.
    """
    verb = (*verb, "--vehicle", VEHICLE)
    rows = fetch_rows(host, *verb)
    try:
        return make_result(rows)
    except (LookupError, TypeError, ValueError, BaqueanoError) as error:
        fix = baqueano_command("robot", "setup", host)
        raise UsageError.of("ssh.other-version", fix, host=host, verb=" ".join(verb)) from error


def _language_setting() -> list[str]:
    """Return the words before a command that make the vehicle answer in the current language, [] for English."""
    return [] if current_language() == "en" else ["env", f"{LANGUAGE_VARIABLE}={current_language()}"]


def _run_quietly(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
