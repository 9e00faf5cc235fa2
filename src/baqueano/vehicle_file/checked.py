"""Check a block of the user by trial calls against the contracts of blocks."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from baqueano import block_checks
from baqueano.block_checks import CHECKS
from baqueano.blocks import ROOMS, classes_in, kinds, resolve, room_of
from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.result import Result
from baqueano.diagnostics import Diagnostic, Verdict, fault, nearest
from baqueano.errors import FileError, UsageError
from baqueano.guides.shapes import circle
from baqueano.messages import text, texts
from baqueano.vehicle_file.file import LOOP_ROOMS, VehicleFile, load

if TYPE_CHECKING:
    from baqueano.contracts.values import TableRow


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CheckedBlock(Result):
    """The findings of the checks of a block."""

    block: str
    room: str
    findings: tuple[Diagnostic, ...]  # a sentence each for its author; none if all is well

    @property
    def verdict(self) -> Verdict:
        """Return USABLE without findings, else the verdict of the most severe finding."""
        return Verdict.of(self.findings)

    def rows(self) -> list["TableRow"]:
        """Return one flat dict per finding."""
        return [
            {"block": self.block, "code": finding.code, "finding": text(finding)} for finding in self.findings
        ]

    def table(self) -> str:
        """Return a text with one line per finding; without findings, the verdict."""
        return "\n".join(f"{self.block}  {finding}" for finding in texts(self.findings)) or str(self.verdict)


def check(block: OwnBlock, vehicle_file: VehicleFile | None = None, room: str | None = None) -> CheckedBlock:
    """Call a block as a drive of a vehicle would, and report its faults.

    Parameters
    ----------
    block : str, type or block
        "file.py:Class", the short name of our block, a class, which is built with the values of the file, or a block.
    vehicle_file : VehicleFile, optional
        The vehicle; by default `small` of the garage.
    room : str, optional
        "vehicle", "sensor", "estimator", …; by default it follows from the arguments of `step`.

    Returns
    -------
    CheckedBlock
        A result with a row per finding.

    Raises
    ------
    UsageError
        For an object that is not a block.
    FileError
        For a block that cannot be built.

    Examples
    --------
    >>> from baqueano.controllers import PdFeedforward
    >>> checked = check(PdFeedforward)
    >>> checked.room, str(checked.verdict)
    ('controller', 'USABLE')
    """
    file = load("small") if vehicle_file is None else vehicle_file
    kind = resolve("estimator", block) if isinstance(block, str) and ".py:" in block else block
    if room is None:
        room = (
            _room_with(kind)
            if isinstance(kind, str)
            else room_of(kind if isinstance(kind, type) else type(kind))
        )
    if room not in CHECKS:
        raise UsageError(fault("cli.block-room", found=room, near=nearest(room, CHECKS)))
    diagnostics = block_checks.check(room, _build(room, block, file), file.sensors, file.vehicle.commands)
    name = block if isinstance(block, str) else (kind if isinstance(kind, type) else type(kind)).__name__
    return CheckedBlock(name, room, tuple(diagnostics))


def _room_with(kind: str) -> str:
    """Return the room that has a block of this short name. UsageError if it is unknown."""
    for room in ROOMS:
        if kind in kinds(room):
            return room
    if kind.endswith(".py"):
        raise UsageError(fault("cli.block-without-class", holds=classes_in(kind)))
    every = [k for room in ROOMS for k in kinds(room)]
    raise UsageError(fault("cli.block-unknown", "baqueano blocks ls", found=kind, near=nearest(kind, every)))


def _build(room: str, block: OwnBlock, file: VehicleFile) -> object:
    """Return the block, built with the values of the vehicle file; else a vehicle or sensor with its defaults.
    Raise FileError if it cannot be built.
    """
    if room == "guide":
        return file.guide(circle(1.0, 0.2), kind=block)
    if room in LOOP_ROOMS:
        return getattr(file, room)(kind=block)
    cls = resolve(room, block) if isinstance(block, str) else block
    if not isinstance(cls, type):
        return cls
    for in_force in (file.vehicle, *file.sensors):
        if type(in_force) is cls:
            return in_force
    try:
        return cls()
    except (TypeError, ValueError) as error:
        raise FileError(fault("cli.block-not-made", kind=cls.__name__, error=error)) from error
