"""Provide the target of a subcommand: a simulated, emulated or real vehicle, all with the same interface."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from baqueano.cli.options import load_truth
from baqueano.cli.terminal import print_message
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import nearest, note
from baqueano.errors import UsageError

if TYPE_CHECKING:
    from baqueano.cli.page.live import LivePage
    from baqueano.door.remote import Remote
    from baqueano.drive.mission import Mission
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

LOCAL_TARGETS = ("simulated", "emulated")
MIN_SIMILARITY = 0.8  # share of letters that a mistyped target has in common with the right name


class Target(Protocol):
    """A target that drives missions, as `open_target` yields it."""

    def drive(
        self, mission: "Mission", vehicle_file: "VehicleFile", path: Path, progress: Callable[[float], None],
        hand: Callable[[], Any] | None = None, **options: Any,
    ) -> "Run":  # fmt: skip
        """Drive a mission with the vehicle of `vehicle_file`, store its run at `path`, and return it."""
        ...

    def return_to_middle(self) -> None:
        """Ensure that the next drive begins in the middle of the room, heading along its width."""
        ...


class LocalTarget:
    """A target in this process; `options` returns the options of `session.drive` for its world."""

    def __init__(self, options: Callable[[], JsonObject], page: "LivePage | None" = None) -> None:
        self._options, self._page = options, page

    def drive(
        self, mission: "Mission", vehicle_file: "VehicleFile", path: Path, progress: Callable[[float], None],
        hand: Callable[[], Any] | None = None, **options: Any,
    ) -> "Run":  # fmt: skip
        """Drive a mission in this process, store its run at `path`, and return it."""
        from baqueano.drive.mission import perform
        from baqueano.drive.observers import Progress

        arguments = self._options() | options
        arguments["observers"] = (Progress(progress), *arguments.get("observers", ()))
        if self._page is not None:
            arguments = self._page.door.local_options(mission, vehicle_file, arguments)
        return perform(mission, vehicle_file, hand, path=path, **arguments)

    def return_to_middle(self) -> None:
        """Print that the vehicle is in the middle again, because each simulated drive begins there."""
        print_message(note("cli.start-in-middle"))


class RemoteTarget:
    """A vehicle that is reached by ssh. Its start pose is the origin of its map."""

    def __init__(self, remote: "Remote", page: "LivePage | None" = None) -> None:
        self._remote, self._page = remote, page

    def drive(
        self, mission: "Mission", vehicle_file: "VehicleFile", path: Path, progress: Callable[[float], None],
        hand: Callable[[], Any] | None = None, **options: Any,
    ) -> "Run":  # fmt: skip
        """Drive a mission with the remote vehicle, store its run at `path`, and return it."""
        from baqueano.drive.mission import pack

        callbacks: dict[str, Any] = {"on_event": print_message} | {
            name: options[name] for name in ("on_event", "words", "on_state") if name in options
        }
        if self._page is not None:
            callbacks |= self._page.door.remote_options(self._remote)
        archive = pack(mission, vehicle_file)
        return self._remote.perform(archive, path, hand=hand, progress=progress, **callbacks)

    def return_to_middle(self) -> None:
        """Wait for the user to confirm that the vehicle is in the middle of the room. Raise click.Abort if not."""
        import click

        print_message(note("cli.put-in-middle"))
        click.confirm("Is it there?", default=True, abort=True, err=True)


@contextmanager
def open_target(
    robot: str, vehicle_file: "VehicleFile", seed: int, backend: str,
    page: "LivePage | None" = None, shake: tuple[str, ...] = (),
) -> Iterator[Target]:  # fmt: skip
    """Yield the target that --robot names, with the faults `shake` of a simulation.

    The name is "simulated" or "emulated", optionally with ":FILE" for the body of another vehicle, or a host.
    """
    kind = robot.partition(":")[0]
    if shake and kind != "simulated":
        raise UsageError.of("shake.robot", host=robot)
    suggestion = nearest(kind, LOCAL_TARGETS, MIN_SIMILARITY)
    if not {"@", "."} & set(robot) and suggestion.figures.get("match", kind) != kind:
        raise UsageError.of("cli.robot-mistyped", value=kind, suggestion=suggestion)
    if kind in LOCAL_TARGETS and ":" not in robot and vehicle_file.simulation.truth is not None:
        print_message(
            note("cli.simulated-truth", vehicle=vehicle_file.label, truth=vehicle_file.simulation.truth)
        )
    if kind == "simulated":
        arguments = {"truth": load_truth(robot, vehicle_file), "seed": seed, "backend": backend}
        arguments |= {"shake": shake} if shake else {}
        yield LocalTarget(lambda: arguments, page)
    elif kind == "emulated":
        from baqueano.robot.emulated import emulate_vehicle

        with emulate_vehicle(vehicle_file, load_truth(robot, vehicle_file), seed) as options:
            yield LocalTarget(lambda: options() | {"seed": seed, "backend": backend}, page)
    else:
        from baqueano.door.remote import connect

        with connect(robot) as remote:
            yield RemoteTarget(remote, page)


def announce_rest(mission: "Mission", vehicle_file: "VehicleFile") -> float:
    """Print how long the vehicle rests before the drive, and return this time [s]; 0 without a rest."""
    rest_s = mission.with_durations(vehicle_file).rest_s or 0.0
    if rest_s:
        print_message(note("drive.rest", rest_s=rest_s))
    return rest_s


def print_fault_detections(run: "Run", vehicle_file: "VehicleFile", shake: tuple[str, ...]) -> None:
    """Print for each fault the checks that detected it, and the times. If no check detected it, print the reason. Also
    print the faults that the drive did not reach.
    """
    if not shake:
        return
    from baqueano.worlds import Fault, fault_ledger

    for words in shake:
        if Fault.parse(words).start_s > run.t_s[-1]:
            print_message(note("ledger.not-reached", fault=words, end_s=run.t_s[-1]))
    ledger = fault_ledger(run, vehicle_file)
    for row in ledger.rows:
        print_message(note("ledger.fault", t_s=row.fault.start_s, fault=row.message))
        for notice in row.notices:
            print_message(
                note(
                    "ledger.detection-line",
                    detector=note(f"ledger.who-{notice.witness}"),
                    delay_s=notice.after_s,
                    reply=notice.message,
                )
            )
        if (reply := ledger.unnoticed_diagnostic(row)) is not None:
            print_message(note("ledger.undetected-line", reply=reply))
