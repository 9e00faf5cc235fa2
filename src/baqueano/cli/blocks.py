"""baqueano blocks."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from baqueano.cli import Verbs, options
from baqueano.cli.terminal import answer, talk
from baqueano.diagnostics import Diagnostic, Verdict, fault, nearest, note
from baqueano.messages import text

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow
    from baqueano.vehicle_file.file import VehicleFile

WHICH = (
    "Which estimator? augmented_ekf for an identified vehicle with any sensors. Until it is identified, with "
    "wheels: dead_reckoning. In a first course: complementary. To compare with the paper: ekf, or unscented. For your "
    "vehicle: baqueano blocks ls"
)


@click.group(cls=Verbs, help="List the blocks; check one of your own.", epilog=WHICH)
def command() -> None: ...


@command.command(
    "ls", help="The blocks that can stand in a vehicle file, by room, and the estimator for its sensors."
)
@options.vehicle
@options.as_json
def ls(vehicle: str | None, settings: tuple[str, ...], as_json: bool) -> None:
    from baqueano.blocks import ROOMS, kinds

    file = options.load_vehicle(vehicle, settings)
    answer(Listed([{"room": room, "kind": kind} for room in ROOMS for kind in kinds(room)]), as_json)
    talk(which_estimator(file))


def which_estimator(file: "VehicleFile") -> Diagnostic:
    """Return the estimator to take for the sensors of a vehicle."""
    from baqueano.estimators.readings.velocity_readings import readings_of, show_place
    from baqueano.vehicle_file.build import DEFAULT_KIND

    names, place = file.sensors._fields, show_place(file.sensors)
    if place:
        fits = "place"
    elif any(not reading.is_gyro for reading in readings_of(file.sensors)):
        fits = "speed"
    else:
        fits = "gyro" if names else "nothing"
    use = ", ".join(f'"{name}"' for name in names)
    usual = DEFAULT_KIND["estimator"]
    return note(f"cli.estimator-{fits}", vehicle=file.name, sensors=names, usual=usual, use=use, place=place)


@command.command(
    "check", help="Say what is wrong with BLOCK (file.py:Class, or a kind of ours), for its author."
)
@click.argument("block")
@click.option(
    "--room", help="vehicle, sensor, estimator, guide, controller, supervisor; found by itself if left out."
)
@options.vehicle
@options.as_json
def check(
    block: str, room: str | None, vehicle: str | None, settings: tuple[str, ...], as_json: bool
) -> None:
    from baqueano.block_checks import CHECKS, check
    from baqueano.blocks import resolve, room_of
    from baqueano.errors import AnswerNo, UsageError

    file = options.load_vehicle(vehicle or "small", settings)
    if room is None:
        room = room_of(resolve("estimator", block)) if ".py:" in block else room_with(block)
    if room not in CHECKS:
        raise UsageError(fault("cli.block-room", found=room, near=nearest(room, CHECKS)))
    found = check(room, built(room, block, file), file.sensors, file.vehicle.commands)
    rows = [{"block": block, "code": one.code, "finding": text(one)} for one in found]
    answer(Listed(rows, Verdict.of(found)), as_json)
    if found:
        raise AnswerNo(fault("cli.block-breaks", block=block, count=len(found)))
    talk(note("cli.block-sound", block=block))


def room_with(kind: str) -> str:
    """The room of a kind of ours."""
    from baqueano.blocks import ROOMS, classes_in, kinds
    from baqueano.errors import UsageError

    for room in ROOMS:
        if kind in kinds(room):
            return room
    if kind.endswith(".py"):
        raise UsageError(fault("cli.block-without-class", holds=classes_in(kind)))
    every = [k for room in ROOMS for k in kinds(room)]
    raise UsageError(fault("cli.block-unknown", "baqueano blocks ls", found=kind, near=nearest(kind, every)))


def built(room: str, kind: str, file: "VehicleFile") -> Any:
    """The block, with what the vehicle file has for it; a vehicle or a sensor with its own defaults."""
    from baqueano.blocks import resolve
    from baqueano.errors import FileError
    from baqueano.guides.shapes import circle

    if room == "guide":
        return file.guide(circle(1.0, 0.2), kind=kind)
    if room in ("estimator", "controller", "supervisor"):
        return getattr(file, room)(kind=kind)
    in_force = {"vehicle": (file.vehicle,), "sensor": tuple(file.sensors)}[room]
    cls = resolve(room, kind)
    for block in in_force:
        if type(block) is cls:
            return block
    try:
        return cls()
    except (TypeError, ValueError) as error:
        raise FileError(fault("cli.block-not-made", kind=kind, error=error)) from error


@dataclass(frozen=True)
class Listed:
    """Rows as they are."""

    found: list["TableRow"]
    verdict: Verdict = Verdict.USABLE

    def rows(self) -> list["TableRow"]:
        """The error as it was found."""
        return self.found

    def table(self) -> str:
        """The same in columns; the verdict where nothing was found."""
        if not self.found:
            return self.verdict
        widths = [max(len(str(row[key])) for row in self.found) for key in self.found[0]]
        return "\n".join(
            "  ".join(str(v).ljust(w) for v, w in zip(row.values(), widths, strict=True)).rstrip()
            for row in self.found
        )
