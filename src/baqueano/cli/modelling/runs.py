"""Define `baqueano runs`: list, show, cut, recover, import and export runs."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from baqueano.cli import numbers, options
from baqueano.cli.blocks import RowsResult
from baqueano.cli.next_command import advise_after_import
from baqueano.cli.report_files import ReportFiles, decimal, report_options
from baqueano.cli.subcommands import SubcommandGroup
from baqueano.cli.terminal import print_answer, print_message, print_result, show_activity, show_steps
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict, fault, note
from baqueano.errors import AnswerNo, UsageError
from baqueano.messages import texts
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.runs.importing import ImportedRun


@click.group(cls=SubcommandGroup, help="List, show, cut, recover, import and export runs.")
def command() -> None: ...


part = options.combine_options(
    click.option(
        "--from", "from_s", type=numbers.time_s, default=0.0, show_default=True,
        help="Start of the part to use [s].",
    ),
    click.option(
        "--to", "to_s", type=numbers.Number("s"), help="End of the part to use [s]; default: the end of the run."
    ),
)  # fmt: skip


@command.command("ls", help="List the runs, one per line.")
@options.runs_folder
@options.as_json
def ls(folder: str, as_json: bool) -> None:
    from baqueano.runs.folder_listing import listing, listing_rows, listing_table

    folder_rows = listing(folder)
    if as_json:
        print_answer(RowsResult(listing_rows(folder_rows)), as_json)
    else:
        print_result(listing_table(folder_rows))


@command.command("show", help="Show the content of RUN: topics, rates, gaps, events.")
@click.argument("run")
@options.runs_folder
@options.as_json
def show(run: str, folder: str, as_json: bool) -> None:
    from baqueano.runs.show import show

    print_answer(show(options.find_runs((run,), folder)[0]), as_json)


@command.command("cut", help="Write the part of RUN between two times [s].")
@click.argument("run")
@part
@options.runs_folder
@options.out
def cut(run: str, from_s: float, to_s: float | None, folder: str, out: Path | None) -> None:
    from baqueano.runs import write_run

    if from_s == 0.0 and to_s is None:
        fix = baqueano_command("runs", "cut", run, "--from", "2", "--to", "30")
        raise UsageError.of("cli.cut-without-effect", fix)
    if to_s is not None and to_s <= from_s:
        fix = baqueano_command("runs", "cut", run, "--from", f"{to_s:g}", "--to", f"{from_s:g}")
        raise UsageError.of("cli.cut-order", fix, start_s=from_s, end_s=to_s)
    whole_run = options.find_runs((run,), folder)[0]
    cut_run = whole_run.cut(from_s, float("inf") if to_s is None else to_s)
    if not len(cut_run.t_ns):
        span = {"run": whole_run.name, "start_s": from_s, "duration_s": whole_run.duration_s}
        raise UsageError(
            fault("cli.cut-after-end", **span) if to_s is None else fault("cli.cut-empty", end_s=to_s, **span)
        )
    path = write_run(cut_run, options.run_path(out, folder, f"{whole_run.name}-cut"))
    print_result(note("cli.cut", path=path, duration_s=cut_run.duration_s))


@command.command("recover", help="Save the complete part of a run that was cut or damaged.")
@click.argument("run")
@options.runs_folder
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    help=("File to write; default: NAME-recovered.mcap in the folder of the run."),
)
def recover(run: str, folder: str, out: Path | None) -> None:
    from baqueano.runs.container.recover import recover
    from baqueano.runs.folder import find

    recovery = recover(find(run, folder), out)
    for diagnostic in recovery.notes:
        print_message(diagnostic)
    print_result(note("cli.recovered", path=recovery.path, duration_s=recovery.run.duration_s))


MAP_EXAMPLE = """A map, as rover.toml, and then: baqueano runs import rover.toml log.csv -o rover.mcap

\b
format = 1
name = "rover"
[files.log]
time = "time_ms"          # a column
time_unit = "ms"          # s, ms, us, ns, min, iso8601
[command]
in_force = "from"         # a row begins its command; "until": ends it
wheels = [                # or names = [...] and u = [...], one each
  { column = "pwm_left", unit = "raw", scale = 0.00392157 },    # of 255
  { column = "pwm_right", unit = "raw", scale = 0.00392157 },
]
[sensors.imu]             # forward, left, turning
z = [
  { column = "ax", unit = "g" },
  { constant = nan },     # not measured
  { column = "gyro", unit = "deg/s" },
]
[truth]                   # a camera, if there is one
eta = [
  { column = "x", unit = "mm" },
  { column = "y", unit = "mm" },
  { column = "yaw", unit = "deg" },
]"""


@command.command(
    "import",
    help="Import CSV files or ROS bags as runs. MAP is a TOML file that assigns their columns. "
    "Each file becomes one run, or several if the map splits it. -o FOLDER keeps their "
    "names; -o NAME.mcap names a single run; by default the runs are numbered.",
    epilog=MAP_EXAMPLE,
)
@click.argument("map", metavar="MAP")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--draft", type=click.Path(path_type=Path), metavar="MAP.toml",
    help="Write a draft of a map from a CSV file, which is given instead of MAP. It fits files with the same columns.",
)  # fmt: skip
@options.vehicle
@options.runs_folder
@options.out
@options.as_json
def import_(
    map: str, files: tuple[Path, ...], draft: Path | None, vehicle: str | None, settings: tuple[str, ...], folder: str,
    out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    if draft is not None:
        return _draft_map(draft, as_json, map, *files)
    if files and files[0].suffix == ".toml" and Path(map).is_file() and Path(map).suffix != ".toml":
        raise UsageError.of("cli.map-second", baqueano_command("runs", "import", files[0], map, *files[1:]))
    from baqueano.runs import write_run
    from baqueano.runs.importing import ImportedRuns, import_runs

    vehicle_file = options.load_vehicle(vehicle, settings) if vehicle else None
    text = "" if vehicle_file is None else vehicle_file.text
    first_name = files[0].name if files else map
    with show_activity(
        note("cli.reading-files", count=len(files))
        if len(files) > 1
        else note("cli.reading", name=first_name)
    ):
        imports = import_runs(map, list(files) or None, text)
    if len(imports) == 1:
        single_file = out is None or out.suffix
        output_path = (
            options.run_path(out, folder, Path(map).stem)
            if single_file
            else _output_path(out, folder, imports[0].run.name)
        )
        path = write_run(imports[0].run, output_path)
        print_answer(WrittenRun(path, imports[0]), as_json)
        advise_after_import([imports[0].run], [path], out, vehicle_file, folder)
        return
    paths = [write_run(item.run, _output_path(out, folder, item.run.name)) for item in imports]
    duration_s = sum(item.run.duration_s for item in imports)
    print_message(
        note("cli.imported", count=len(paths), first=paths[0], last=paths[-1], duration_s=duration_s)
    )
    print_answer(ImportedRuns(tuple(imports)), as_json)
    advise_after_import([item.run for item in imports], [paths[0], paths[-1]], out, vehicle_file, folder)


def _draft_map(path: Path, as_json: bool, *recordings: Path | str) -> None:
    """Write the draft of a map for recordings with the same columns to the file `path`."""
    from baqueano.runs.importing.draft import UNKNOWN, draft_map

    missing_units = draft_map(*recordings, path=path).count(f'"{UNKNOWN}"')
    code = "cli.drafted" if missing_units else "cli.drafted-complete"
    message = note(code, fix=baqueano_command("runs", "import", path, *recordings), path=path)
    if not as_json:
        return print_result(message)
    print_answer(RowsResult([{"map": str(path), "missing_units": missing_units}]), as_json)
    print_message(message)


class WrittenRun(NamedTuple):
    """An imported run, the path of its file, and the findings about the import."""

    path: Path
    import_result: "ImportedRun"

    @property
    def verdict(self) -> str:
        """Return the verdict of the import."""
        return self.import_result.verdict

    def rows(self) -> list[TableRow]:
        """Return the content of the run, then the findings, each with the run's path."""
        run_row = {"level": "run", "finding": "", "t_s": None, "text": self._content_text()}
        return [{"run": str(self.path)} | row for row in [run_row, *self.import_result.rows()]]

    def table(self) -> str:
        """Return content and findings as a text table."""
        return "\n".join(
            filter(
                None,
                (
                    _("run: {path}, {holds}", path=self.path, holds=self._content_text()),
                    self.import_result.without_common_findings.table(),
                ),
            )
        )

    def _content_text(self) -> str:
        run = self.import_result.run
        channels = [*run.sensors, *([_("truth")] if run.truth is not None else [])]
        return _(
            "{ticks} ticks, {duration_s:.1f} s, with {sensors}",
            ticks=len(run.t_ns), duration_s=run.duration_s, sensors=", ".join(channels) or _("commands alone"),
        )  # fmt: skip


def _output_path(out: Path | None, folder: str, name: str) -> Path:
    """Return the file for a run of that name in the folder `out`. If `out` is None, return a numbered file in
    `folder`. Raise UsageError if `out` is a file."""
    if out is not None and out.suffix:
        raise UsageError.of("cli.several-runs", f"-o {out.stem}", path=out)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    from baqueano.runs.folder import plain_label

    return options.run_path(None if out is None else out / f"{plain_label(name)}.mcap", folder, name)


@command.command(
    "calibrate",
    help="Calibrate the gyro, the odometer and the clocks of RUN with its truth (a camera), without a "
    "model. In a run without commands, the gyro is calibrated with whole turns by hand, between rests "
    "on a mark.",
)
@click.argument("run")
@click.option(
    "--turns",
    type=numbers.count,
    help=("Number of whole turns by hand between two rests; default: the nearest number."),
)
@click.option(
    "--map", "map_", type=click.Path(path_type=Path),
    help="Write the position of the camera's mark, and its clock offset, into the map of RUN.",
)  # fmt: skip
@options.vehicle
@options.runs_folder
@options.update
@options.as_json
def calibrate(
    run: str, turns: int | None, map_: Path | None, vehicle: str | None, settings: tuple[str, ...], folder: str,
    update: bool, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.calibration.against_truth import calibrate
    from baqueano.calibration.hand_turns import calibrate_by_hand_turns, is_turned_by_hand

    vehicle_file, recorded_run = options.load_vehicle(vehicle, settings), options.find_runs((run,), folder)[0]
    if turns is not None or is_turned_by_hand(recorded_run):
        calibration = calibrate_by_hand_turns(recorded_run, vehicle_file, turns)
    else:
        with show_activity(note("cli.comparing")):
            calibration = calibrate(recorded_run, vehicle_file)
    print_answer(calibration, as_json)
    if calibration.verdict == Verdict.REFUSED:
        raise AnswerNo.of("cli.calibration-refused", reasons="; ".join(texts(calibration.reasons)))
    if map_ is not None:
        from baqueano.runs.maps.mount import write_mount

        write_mount(map_, recorded_run, *calibration.mount(vehicle_file))
        fix = baqueano_command("runs", "import", str(map_), "RECORDING")
        print_message(note("cli.mount-written", fix=fix, path=map_))
    options.save_update(calibration.updated_file(vehicle_file), update)


@command.command("export", help="Write RUN as CSV (one table) or TUM (a trajectory for evo and others).")
@click.argument("run")
@click.option(
    "--to", type=click.Choice(["csv", "tum"]), default="csv", show_default=True, help="Format of the file."
)
@click.option(
    "--trajectory",
    default="estimate",
    show_default=True,
    help=("Trajectory to write as TUM: estimate, truth or reference."),
)
@decimal
@options.runs_folder
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    help="File to write; default: the name of the run, .csv or .tum.",
)
def export(run: str, to: str, trajectory: str, decimal: str, folder: str, out: Path | None) -> None:
    from baqueano.runs.export import export_csv, export_tum

    loaded_run = options.find_runs((run,), folder)[0]
    path = out if out is not None else Path(f"{loaded_run.name}.{to}")
    exported_path = (
        export_csv(loaded_run, path, decimal) if to == "csv" else export_tum(loaded_run, path, trajectory)
    )
    print_result(str(exported_path))


@command.command(
    "noise", help="Measure the sensors of RUN at rest: bias, Allan deviation, effect of temperature."
)
@click.argument("run")
@part
@options.vehicle
@options.runs_folder
@options.update
@report_options
@options.as_json
def noise(
    run: str, from_s: float, to_s: float | None, vehicle: str | None, settings: tuple[str, ...], folder: str,
    update: bool, report: ReportFiles, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.calibration.at_rest import measure_at_rest

    recorded_run = options.find_runs((run,), folder)[0]
    with show_activity(note("cli.averaging")):
        rest_result = measure_at_rest(recorded_run, from_s, float("inf") if to_s is None else to_s)
    print_answer(rest_result, as_json)
    report.write_page(rest_result)
    if vehicle or update:
        options.save_update(rest_result.updated_file(options.load_vehicle(vehicle, settings)), update)


@command.command(
    "wear",
    help=(
        "Find the parameters that changed by more than their error bars over several RUNS, and the runs between "
        "which they changed."
    ),
)
@click.argument("runs", nargs=-1, required=True)
@options.vehicle
@options.backend
@options.runs_folder
@report_options
@options.as_json
def wear(
    runs: tuple[str, ...], vehicle: str | None, settings: tuple[str, ...], backend: str, folder: str,
    report: ReportFiles, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.identify import FitOptions
    from baqueano.validation.parameter_drift import Drift, parameter_history

    recorded_runs, fit_options = options.find_runs(runs, folder), FitOptions(backend=backend)
    with show_steps() as begin:
        history = parameter_history(
            recorded_runs, options.load_vehicle(vehicle, settings), options=fit_options, progress=begin
        )
    print_answer(Drift(history), as_json)
    report.write_page(history)
