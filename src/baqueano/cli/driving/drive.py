"""Define `baqueano drive`: drive manually from this terminal."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from baqueano.cli import numbers, options
from baqueano.cli.driving.drive_options import DriveOptions, drive_options
from baqueano.cli.driving.manual_drive import (
    drive_manually,
    drive_on_page,
    finish_manual_drive,
    hold_option,
    mark_scales,
    pad_option,
)
from baqueano.cli.page import live
from baqueano.cli.terminal import print_answer, print_message
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict, note
from baqueano.messages.language import translate as _

if TYPE_CHECKING:
    from baqueano.runs.run import Run


@click.command(help="Drive manually from this terminal, with keys or a game pad; write a run.")
@options.vehicle
@options.robot
@click.option("--latched", is_flag=True, help="Each key press changes a set-point, which is kept.")
@click.option(
    "--command-share", type=numbers.Number("", 0.1, 1.0, excludes_low=False), default=0.5, show_default=True,
    help="Fraction of the command's limit with a key fully pressed (0.1 to 1); + and - change it.",
)  # fmt: skip
@pad_option
@hold_option
@click.option(
    "--length", "length_m", type=numbers.length,
    help="Distance between the first and the last mark, by tape [m]; gives the scale of the wheels.",
)  # fmt: skip
@options.seed
@options.backend
@options.runs_folder
@options.out
@click.option("--update", is_flag=True, help="Write the scales from the marks into the vehicle file.")
@live.page
@options.as_json
@drive_options
def command(
    drive: DriveOptions, latched: bool, command_share: float, pad: str | None, hold: bool, length_m: float | None,
    update: bool, as_json: bool,
) -> None:  # fmt: skip
    if drive.show_page:
        options.refuse_together("--page", "latched", "command_share", "pad")
    vehicle_file = drive.load_vehicle()
    options.advise_to_measure(vehicle_file, drive.robot)
    path = drive.run_path("drive")
    terminal_drive = partial(drive_manually, pad=pad, command_share=command_share, latched=latched)
    make_drive = drive_on_page if drive.show_page else terminal_drive
    run = make_drive("drive", vehicle_file, drive, path, hold=hold)
    print_message(note("cli.run", path=path))
    finish_manual_drive(run, path, drive.robot)
    text, values = mark_scales(run, vehicle_file, length_m)
    print_answer(DriveResult(run, path, values), as_json)
    print_message(text)
    if values and update:
        options.save_update(vehicle_file.with_values(values), update)


@dataclass(frozen=True)
class DriveResult:
    """The result of a manual drive."""

    run: "Run"
    path: Path
    values: dict[str, object]  # of the vehicle file, from the marks of the run
    verdict: str = Verdict.USABLE

    def rows(self) -> list[TableRow]:
        """Return one row: path of the run, duration, marks, and the scales that the marks determine."""
        from baqueano.drive.session import mark_times_ns

        mark_count = len(mark_times_ns(self.run))
        return [{"run": str(self.path), "duration_s": self.run.duration_s, "marks": mark_count} | self.values]

    def table(self) -> str:
        """Return the row as a sentence."""
        (row,) = self.rows()
        return _("the drive lasted {duration_s:.1f} s, with {marks} marks: {run}", **row)
