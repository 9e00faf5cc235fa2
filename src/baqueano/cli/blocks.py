"""Define `baqueano blocks`: list the blocks, and check a block."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from baqueano.cli import options
from baqueano.cli.subcommands import SubcommandGroup
from baqueano.cli.terminal import print_answer, print_message
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Diagnostic, Verdict, note
from baqueano.errors import AnswerNo
from baqueano.messages.language import mark as N_, translate as _
from baqueano.messages.text_table import text_table

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

ESTIMATOR_ADVICE = (
    "Which estimator? augmented_ekf for an identified vehicle with any sensors. Until it is identified, with "
    "wheels: dead_reckoning. In a first course: complementary. To compare with the paper: ekf, or unscented. For your "
    "vehicle: baqueano blocks ls"
)


@click.group(cls=SubcommandGroup, help="List the blocks; check one of your own.", epilog=ESTIMATOR_ADVICE)
def command() -> None: ...


@command.command("ls", help="List the blocks for a vehicle file, by type, and the estimator for its sensors.")
@options.vehicle
@options.as_json
def ls(vehicle: str | None, settings: tuple[str, ...], as_json: bool) -> None:
    from baqueano.blocks import BLOCK_TARGETS, kinds

    vehicle_file = options.load_vehicle(vehicle, settings)
    print_answer(
        RowsResult([{"role": role, "kind": kind} for role in BLOCK_TARGETS for kind in kinds(role)]), as_json
    )
    print_message(recommend_estimator(vehicle_file))


def recommend_estimator(vehicle_file: "VehicleFile") -> Diagnostic:
    """Return a message with the recommended estimator for the sensors of a vehicle."""
    from baqueano.estimators.readings.velocity_readings import pose_sensors, velocity_readings
    from baqueano.vehicle_file.build import DEFAULT_KINDS

    names, pose_sensor_names = vehicle_file.sensors._fields, pose_sensors(vehicle_file.sensors)
    if pose_sensor_names:
        case = "place"
    elif any(not reading.is_gyro for reading in velocity_readings(vehicle_file.sensors)):
        case = "speed"
    else:
        case = "gyro" if names else "nothing"
    use = ", ".join(f'"{name}"' for name in names)
    default_kind = DEFAULT_KINDS["estimator"]
    return note(
        f"cli.estimator-{case}",
        vehicle=vehicle_file.name,
        sensors=names,
        estimator=default_kind,
        use=use,
        place=pose_sensor_names,
    )


@command.command("check", help="Check BLOCK (file.py:Class, or the name of a block), and explain each fault.")
@click.argument("block")
@click.option(
    "--role",
    help=(
        "Type of the block: vehicle, sensor, estimator, guide, controller or supervisor; default: detected "
        "from its methods."
    ),
)
@options.vehicle
@options.as_json
def check(
    block: str, role: str | None, vehicle: str | None, settings: tuple[str, ...], as_json: bool
) -> None:
    from baqueano.vehicle_file.block_check import check

    report = check(block, options.load_vehicle(vehicle or "small", settings), role)
    print_answer(report, as_json)
    if report.verdict == Verdict.REFUSED:
        raise AnswerNo.of("cli.block-breaks", block=block, count=len(report.findings))
    if not report.findings:
        print_message(note("cli.block-correct", block=block))


TEXT_COLUMNS = {  # columns that are words; the others are typed
    "role": (N_("vehicle"), N_("sensor"), N_("estimator"), N_("guide"), N_("controller"), N_("supervisor"))
}


@dataclass(frozen=True)
class RowsResult:
    """The result of a listing: rows of a table."""

    findings: list[TableRow]
    verdict: Verdict = Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return the rows of the listing."""
        return self.findings

    def table(self) -> str:
        """Return the rows in columns; the verdict if the list is empty."""
        if not self.findings:
            return _(self.verdict)
        cells = [
            [_(str(v)) if key in TEXT_COLUMNS else str(v) for key, v in row.items()] for row in self.findings
        ]
        return "\n".join(text_table("<" * len(cells[0]), *cells))
