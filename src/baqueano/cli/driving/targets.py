"""Targets of a verb: a simulation, the emulated vehicle, or the real one, all with the same interface."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from baqueano.cli.options import load_truth
from baqueano.cli.terminal import talk
from baqueano.diagnostics import fault, nearest, note
from baqueano.errors import UsageError

if TYPE_CHECKING:
    from baqueano.cli.page.live import LivePage
    from baqueano.contracts.values import JsonObject
    from baqueano.door.remote import Remote
    from baqueano.drive.mission import Mission
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

IN_HERE = ("simulated", "emulated")
LIKE = 0.85  # share of letters that a mistyped target has in common with the right name


class Place(Protocol):
    """A target that drives missions, as `placed` yields it."""

    def drive(
        self, mission: "Mission", file: "VehicleFile", path: Path, progress: Callable[[float], None],
        hand: Callable[[], Any] | None = None, **options: Any,
    ) -> "Run":  # fmt: skip
        """Return the run of a mission for the vehicle of `file`; the run is then stored at `path`."""
        ...

    def back_in_the_middle(self) -> None:
        """Ensure that the next drive begins in the middle of the room, heading along its width."""
        ...


class Here:
    """A target in this process; `options` returns the options of `session.drive` for its world."""

    def __init__(self, options: Callable[[], "JsonObject"], page: "LivePage | None" = None) -> None:
        self._options, self._page = options, page

    def drive(
        self, mission: "Mission", file: "VehicleFile", path: Path, progress: Callable[[float], None],
        hand: Callable[[], Any] | None = None, **options: Any,
    ) -> "Run":  # fmt: skip
        """Return the run of a mission in this process; the run is then stored at `path`."""
        from baqueano.drive.mission import perform
        from baqueano.drive.observers import Progress

        arguments = self._options() | options
        arguments["observers"] = (Progress(progress), *arguments.get("observers", ()))
        if self._page is not None:
            arguments = self._page.door.local_options(mission, file, arguments)
        return perform(mission, file, hand, path=path, **arguments)

    def back_in_the_middle(self) -> None:
        """Report that the vehicle is in the middle again: each simulated drive begins there."""
        talk(note("cli.middle-again"))


class There:
    """A vehicle that is reached by ssh. The start of a drive there is the origin of its map."""

    def __init__(self, remote: "Remote", attended: bool, page: "LivePage | None" = None) -> None:
        self._remote, self._attended, self._page = remote, attended, page

    def drive(
        self, mission: "Mission", file: "VehicleFile", path: Path, progress: Callable[[float], None],
        hand: Callable[[], Any] | None = None, **options: Any,
    ) -> "Run":  # fmt: skip
        """Return the run of a mission of the remote vehicle; the run is then stored at `path`."""
        from baqueano.drive.mission import packed

        callbacks: dict[str, Any] = {"say": talk} | {
            name: options[name] for name in ("say", "words", "on_state") if name in options
        }
        if self._page is not None:
            callbacks |= self._page.door.remote_options(self._remote)
        return self._remote.perform(
            packed(mission, file), path, attended=self._attended, hand=hand, progress=progress, **callbacks
        )

    def back_in_the_middle(self) -> None:
        """Wait until the user confirms that the vehicle is there."""
        import click

        talk(note("cli.put-back"))
        click.confirm("Is it there?", default=True, abort=True, err=True)


@contextmanager
def placed(
    robot: str, file: "VehicleFile", seed: int, backend: str, attended: bool = True,
    page: "LivePage | None" = None, shake: tuple[str, ...] = (),
) -> Iterator[Place]:  # fmt: skip
    """Yield the target that --robot names, with the faults `shake` of a simulation.

    The names are "simulated" or "emulated", each with ":FILE" for the body of another vehicle, or a host.
    """
    kind = robot.partition(":")[0]
    if shake and kind != "simulated":
        raise UsageError(fault("shake.robot", host=robot))
    near = nearest(kind, IN_HERE, LIKE)
    if not {"@", "."} & set(robot) and near.figures.get("meant", kind) != kind:
        raise UsageError(fault("cli.robot-mistyped", found=kind, near=near))
    if kind in IN_HERE and ":" not in robot and file.simulation.truth is not None:
        talk(note("cli.simulated-truth", vehicle=file.label, truth=file.simulation.truth))
    if kind == "simulated":
        arguments = {"truth": load_truth(robot, file), "seed": seed, "backend": backend}
        arguments |= {"shake": shake} if shake else {}
        yield Here(lambda: arguments, page)
    elif kind == "emulated":
        from baqueano.robot.emulated import emulated

        with emulated(file, load_truth(robot, file), seed) as options:
            yield Here(lambda: options() | {"seed": seed, "backend": backend}, page)
    else:
        from baqueano.door.remote import reached

        with reached(robot) as remote:
            yield There(remote, attended, page)


def say_ledger(run: "Run", file: "VehicleFile", shake: tuple[str, ...]) -> None:
    """Print for each fault the checks that noticed it, and when, or the reason why none did."""
    if not shake:
        return
    from baqueano.worlds import ledger_of

    ledger = ledger_of(run, file)
    for row in ledger.rows:
        talk(note("ledger.fault", at_s=row.fault.at_s, what=row.message))
        for notice in row.noticed:
            talk(
                note(
                    "ledger.noticed",
                    who=note(f"ledger.who-{notice.witness}"),
                    after_s=notice.after_s,
                    said=notice.message,
                )
            )
        if (nobody := ledger.nobody(row)) is not None:
            talk(note("ledger.by-nobody", said=nobody))
