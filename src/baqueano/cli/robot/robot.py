"""Define `baqueano robot`: `run` runs the service on the vehicle; the others maintain a vehicle from any computer."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from baqueano.cli import options
from baqueano.cli.robot import settings, setup, workshop
from baqueano.cli.subcommands import SUBCOMMANDS, SubcommandGroup
from baqueano.cli.terminal import print_answer, print_message, print_result
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, StopReason, note, stop as because
from baqueano.door import SOCKET
from baqueano.errors import FileError
from baqueano.messages import text
from baqueano.messages.language import number
from baqueano.messages.printable import baqueano_command, join_rows, one_line

if TYPE_CHECKING:
    from baqueano.door.remote import Remote

ANSWER_S = 10.0  # timeout of the first bytes of a run
host = click.argument("host", default="here")


@click.group(cls=SubcommandGroup, help=SUBCOMMANDS["robot"])
def command() -> None:
    pass


@command.command(help="Run the service of the vehicle, on the vehicle. Normally systemd starts it.")
@options.vehicle
@options.runs_folder
@click.option("--door", type=click.Path(path_type=Path), default=SOCKET, show_default=True,
              help="Socket on which the service listens.")  # fmt: skip
def run(vehicle: str | None, settings: tuple[str, ...], folder: str, door: Path) -> None:
    import gc

    from baqueano.robot.uno.serial_port import reset_uno_early

    gc.disable()  # request_realtime() enables it again: loading does not produce garbage
    try:
        give_back = (lambda: None) if settings else reset_uno_early(Path(vehicle or options.DEFAULT_FILE))
        from baqueano.robot.service.onboard import serve

        serve(options.load_vehicle(vehicle, settings), Path(folder), door, print_result, give_back)
    finally:
        gc.enable()


@command.command(
    help="Connect stdin and stdout to the service of this vehicle. ssh does this for --robot HOST."
)
@click.option(
    "--door",
    type=click.Path(path_type=Path),
    default=SOCKET,
    show_default=True,
    help="Socket of the service.",
)
def attach(door: Path) -> None:
    from baqueano.door.pipes import attach

    attach(door, sys.stdin.buffer, sys.stdout.buffer)


@command.command(help="Show the state of the vehicle at HOST, and why it cannot drive.")
@host
@options.as_json
def status(host: str, as_json: bool) -> None:
    from baqueano.door.states import DoorState

    with _connection(host) as remote:
        print_answer(RobotStatus(remote.state), as_json)
        if remote.state.get("state") == DoorState.STOPPED:
            _advise_to_clear(host)


@command.command(help="Stop the vehicle at HOST at once; the stop lasts until it is cleared.")
@host
def stop(host: str) -> None:
    from baqueano.door.remote import stop

    print_result(f"{host}: {stop(host, because(StopReason.STOPPED_BY_COMMAND))['state']}")
    _advise_to_clear(host)


@command.command(help="Clear a stop of the vehicle at HOST, after you have checked the vehicle.")
@host
def clear(host: str) -> None:
    with _connection(host) as remote:
        remote.send(type="clear")
        remote.wait(lambda: remote.state["state"] == "READY", 2.0)
        state = remote.state
        print_result(
            f"{host}: {state['state']}" + (f": {text(state['reason'])}" if state.get("reason") else "")
        )


@command.command(
    help=("List the runs on the vehicle at HOST; with --fetch, copy those that are missing here.")
)
@host
@click.option("--fetch", is_flag=True, help="Copy the runs into the folder of runs.")
@options.runs_folder
def runs(host: str, fetch: bool, folder: str) -> None:
    from os.path import lexists

    from baqueano.door.ssh import ssh_line
    from baqueano.runs.folder import is_run_name

    with _connection(host) as remote:
        names = remote.run_names()
        for name in filter(is_run_name, names):
            if not fetch:
                print_result(name)
                continue
            if not lexists(local_path := _local_path(remote, name, Path(folder))):
                remote.fetch(name, local_path)
            print_result(f"{name}  {local_path}")
    if invalid_names := [name for name in names if not is_run_name(name)]:
        invalid_list = ", ".join(f'"{one_line(str(name))}"' for name in invalid_names[:5])
        raise FileError.of(
            "cli.run-names-invalid", ssh_line(host), host=host, count=len(invalid_names), value=invalid_list
        )


for verb in (
    setup.card, setup.setup, setup.remove,
    workshop.doctor, workshop.flash, workshop.calibrate, settings.settings,
):  # fmt: skip
    command.add_command(verb)


def _local_path(remote: "Remote", name: str, folder: Path) -> Path:
    """Return the copy of a run of the vehicle, or else a new path. A run of another vehicle can have the same name."""
    from itertools import count
    from os.path import lexists

    paths = (folder / (name if k == 1 else f"{Path(name).stem}-{k}.mcap") for k in count(1))
    return next(path for path in paths if not lexists(path) or _is_copy(remote, name, path))


def _is_copy(remote: "Remote", name: str, path: Path) -> bool:
    """Return True if a file has the length and the first bytes of a run of the vehicle, which contain its times."""
    import base64
    from contextlib import suppress

    remote.send(type="head", run=name)
    message = remote.receive(("file",), ANSWER_S)
    with suppress(OSError, ValueError):
        first = base64.b64decode(message["data"], validate=True)
        content = path.read_bytes()
        return len(content) == len(first) + message["left"] and content.startswith(first)
    return False


def _advise_to_clear(host: str) -> None:
    print_message(note("door.clear", fix=baqueano_command("robot", "clear", host)))


class RobotStatus:
    """The state that the vehicle reports."""

    def __init__(self, reply: JsonObject) -> None:
        self.reply = {k: v for k, v in reply.items() if k != "type"}
        self.verdict = str(reply.get("state"))

    def rows(self) -> list[TableRow]:
        """Return one row, with the reason of a stop as a sentence, as a code, and as values."""
        reason = self.reply.get("reason")
        data = reason.to_json() if isinstance(reason, Diagnostic) else {"code": None, "figures": {}}
        readable_reply = {k: text(v) if isinstance(v, Diagnostic) else v for k, v in self.reply.items()}
        return [readable_reply | {"code": data["code"], "figures": data["figures"]}]

    def table(self) -> str:
        """Return a line of text for each known value."""
        (row,) = self.rows()
        name_width = max(len(name) for name in self.reply)
        shown_values = {
            k: f"{number(row[k]):.4g}" if isinstance(row[k], float) else row[k] for k in self.reply
        }
        return join_rows(f"{k:{name_width}}  {v}" for k, v in shown_values.items() if v not in (None, ""))


def _connection(host: str) -> Any:
    from baqueano.door.remote import connect

    return connect(host)
