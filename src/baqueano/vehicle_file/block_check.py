"""Check a block of the user by trial calls against the contracts of blocks."""

from dataclasses import dataclass

from baqueano import block_checks
from baqueano.block_checks import CHECKS
from baqueano.blocks import BLOCK_TARGETS, describe_classes, infer_role, kinds, resolve
from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result
from baqueano.contracts.time_limit import PREPARE_S, within
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Verdict, fault, nearest
from baqueano.errors import FileError, UsageError
from baqueano.guides.shapes import circle
from baqueano.messages import text, texts
from baqueano.vehicle_file.build import with_usual_std
from baqueano.vehicle_file.file import LOOP_ROLES, VehicleFile, load


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BlockCheck(Result):
    """The findings of the checks of a block."""

    block: str
    role: str
    findings: tuple[Diagnostic, ...]  # messages for the author of the block; empty without faults
    notes: tuple[Diagnostic, ...] = ()  # the reason why a correct block cannot be compiled

    @property
    def verdict(self) -> Verdict:
        """Return USABLE without findings, else the verdict of the most severe finding."""
        return Verdict.of(self.findings)

    def rows(self) -> list[TableRow]:
        """Return one flat dict per finding."""
        return [
            {"block": self.block, "code": finding.code, "finding": text(finding)} for finding in self.findings
        ]

    def table(self) -> str:
        """Return a text with one line per finding; without findings, the verdict and the notes."""
        return "\n".join(texts(self.findings) or [str(self.verdict), *texts(self.notes)])


@checked_call("bq.check(MyController)")
def check(block: OwnBlock, vehicle_file: VehicleFile | None = None, role: str | None = None) -> BlockCheck:
    """Call a block as a drive of a vehicle would, and report its faults.

    Parameters
    ----------
    block : str, type or block
        "file.py:Class", the short name of a built-in block, a class, or a block. A class is built with the values of
        the file.
    vehicle_file : VehicleFile, optional
        The vehicle; by default `small` of the garage.
    role : str, optional
        Role of the block: "vehicle", "sensor", "estimator", …; by default it follows from the arguments of `step`.

    Returns
    -------
    BlockCheck
        A result with a row per finding.

    Raises
    ------
    UsageError
        For an object that is not a block, or an unknown role.
    FileError
        For a block that cannot be built.

    Examples
    --------
    >>> from baqueano.controllers import PdFeedforward
    >>> result = check(PdFeedforward)
    >>> result.role, str(result.verdict)
    ('controller', 'USABLE')
    """
    if not isinstance(block, str | type) and getattr(block, "step", None) is None:
        raise UsageError.of("block.not-a-block", role="block", value=type(block).__name__)
    checked_vehicle = load("small") if vehicle_file is None else vehicle_file
    block_or_class = resolve("estimator", block) if isinstance(block, str) and ".py:" in block else block
    if role is None:
        role = (
            _kind_role(block_or_class)
            if isinstance(block_or_class, str)
            else infer_role(block_or_class if isinstance(block_or_class, type) else type(block_or_class))
        )
    if role not in CHECKS:
        raise UsageError.of("cli.block-role", value=role, suggestion=nearest(role, CHECKS))
    own_block = _build(role, block, checked_vehicle)
    surroundings = checked_vehicle.sensors, checked_vehicle.vehicle.commands
    diagnostics = block_checks.check(role, own_block, *surroundings)
    notes = [] if diagnostics else block_checks.compilation_notes(role, own_block, *surroundings)
    if role in ("vehicle", "sensor"):  # a block of another role may run uncompiled
        diagnostics += [
            fault("check.must-compile", cause=cause, subject=entry.subject, place=entry.figures["place"])
            for entry in notes
            if (cause := entry.figures.get("cause")) is not None
        ]
    name = (
        block
        if isinstance(block, str)
        else (block_or_class if isinstance(block_or_class, type) else type(block_or_class)).__name__
    )
    return BlockCheck(name, role, tuple(diagnostics), () if diagnostics else tuple(notes))


def _kind_role(kind: str) -> str:
    """Return the role of the built-in block with this short name. Raise UsageError if the name is unknown."""
    for role in BLOCK_TARGETS:
        if kind in kinds(role):
            return role
    if kind.endswith(".py"):
        raise UsageError.of("cli.block-without-class", classes=describe_classes(kind))
    all_kinds = [k for role in BLOCK_TARGETS for k in kinds(role)]
    raise UsageError.of(
        "cli.block-unknown", "baqueano blocks ls", value=kind, suggestion=nearest(kind, all_kinds)
    )


def _build(role: str, block: OwnBlock, vehicle_file: VehicleFile) -> object:
    """Return the block, built with the values of the vehicle file, or a vehicle or sensor with its defaults.
    Raise FileError if the block cannot be built.
    """
    if role == "guide":
        return vehicle_file.guide(circle(1.0, 0.2), kind=block)
    if role in LOOP_ROLES:
        return getattr(vehicle_file, role)(kind=block)
    block_class = resolve(role, block) if isinstance(block, str) else block
    if not isinstance(block_class, type):
        return block_class
    for file_block in (vehicle_file.vehicle, *vehicle_file.sensors):
        if type(file_block) is block_class:
            return file_block
    try:
        own_block = within(PREPARE_S, block_class)
    except (TypeError, ValueError) as error:
        raise FileError.of("cli.block-needs-arguments", kind=block_class.__name__, error=error) from error
    return with_usual_std(own_block) if role == "sensor" else own_block
