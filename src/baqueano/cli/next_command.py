"""Suggest the command to type after an import, or after an error: never the failed command unchanged.

The suggestion depends on the code and the values of the error. A mistyped name (`value`, with the nearest name in
`near`, see names.py) is corrected in the command. A `missing` path is replaced by the nearest file, and a decimal comma
by a point. Otherwise the suggestion is the error's `fix`. For an error without a `fix`, the suggestion depends on the
error: --help after a usage error, the help on maps after a bad map, the list of runs after a bad run.
"""

import difflib
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.cli import options
from baqueano.cli.terminal import print_message
from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.compare import Comparison
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

USAGE, BAD_FILE = 2, 3
CAR_COMMANDS = 2  # throttle and steering
GROUPS = (["runs"], ["route"], ["study"], ["blocks"], ["robot"])
MIN_SIMILARITY = 0.75  # share of characters that two similar file names have in common
DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
BARE_LIST = re.compile(r"=([-+\d.e]+(?:,[-+\d.e]+){2,})$")  # KEY=1,2,3
COMMA_INDEPENDENT = (
    "cli.no-such-option", "cli.whole-number", "cli.pose-unreadable", "cli.start-unreadable", "cli.tolerance-car",
    "cli.tolerance-unused", "room.unreadable",
)  # fmt: skip
ALLOWABLE_CODES = ("block.outside-folder", "block.in-run")
UNWRITTEN_CODES = ("vehicle.changed-since", "vehicle.not-written", "runs.not-written")  # of a right command
NAMES_CODES = ("name.near", "name.near-only", "name.unknown", "name.unknown-only")
MAX_LISTED_FILES = 5  # files of a folder that are named


def next_command(diagnostic: Diagnostic, code: int, args: list[str]) -> Diagnostic | None:
    """Return the command to type next; None if the error contains it, or if no command is known for this error.

    args: the command line, without `baqueano`.
    """
    if code not in (USAGE, BAD_FILE):
        return None
    causes = list(_causes(diagnostic))
    correction = _correction(causes, args, is_usage=code == USAGE)
    if correction is not None or any(cause.fix for cause in causes):
        return correction
    if code == USAGE:
        return fault("next.options", baqueano_command(*args[: 2 if args[:1] in GROUPS else 1], "--help"))
    if any(cause.code in NAMES_CODES for cause in causes):  # the message lists the files already
        return None
    if paths := _missing_paths(causes):
        return _sibling_files(paths[0])
    rooms = {cause.code.partition(".")[0] for cause in causes}
    if "map" in rooms:
        return fault("next.map", baqueano_command("runs", "import", "--help"))
    return fault("next.runs", baqueano_command("runs", "ls")) if "runs" in rooms else None


def _correction(causes: list[Diagnostic], args: list[str], is_usage: bool) -> Diagnostic | None:
    """Return the command line in a form that avoids one of the causes; None if no such form is known."""
    codes = {cause.code for cause in causes}
    for cause in causes:
        if (corrected_args := _corrected_args(cause, args)) is not None:
            return fault("next.put-right", baqueano_command(*corrected_args))
    recorded_runs = {
        run for cause in causes for run in str(cause.figures.get("recorded_runs", "")).split(", ")
    }
    if recorded_runs & {*args}:
        return fault("next.put-right", baqueano_command(*(arg for arg in args if arg not in recorded_runs)))
    if "cli.figures-absent" in codes:
        return fault("next.put-right", baqueano_command(*args, "--figures", "figures"))
    if codes.intersection(UNWRITTEN_CODES):
        return fault("next.put-right", baqueano_command(*args))
    if codes.intersection(ALLOWABLE_CODES):
        return fault("next.allow-blocks", baqueano_command(*args, "--allow-blocks"))
    if is_usage and (corrected_args := [BARE_LIST.sub(r"=[\1]", arg) for arg in args]) != args:
        return fault("next.put-right", baqueano_command(*corrected_args))
    for path in _missing_paths(causes):
        if (near_path := _nearest_file(path)) is not None and str(path) in args:
            corrected_args = [str(near_path) if Path(arg) == path else arg for arg in args]
            return fault("next.near-file", baqueano_command(*corrected_args), match=near_path)
    if (
        is_usage
        and codes.isdisjoint(COMMA_INDEPENDENT)
        and (corrected_args := _with_decimal_points(args)) != args
    ):
        return fault("next.decimal-comma", baqueano_command(*corrected_args))
    return None


def _missing_paths(causes: list[Diagnostic]) -> list[Path]:
    return [Path(str(cause.figures["absent_path"])) for cause in causes if "absent_path" in cause.figures]


def _causes(diagnostic: Diagnostic) -> Iterator[Diagnostic]:
    """Yield the message, and all messages in its values."""
    yield diagnostic
    for figure in diagnostic.figures.values():
        if isinstance(figure, Diagnostic):
            yield from _causes(figure)


def _corrected_args(cause: Diagnostic, args: list[str]) -> list[str] | None:
    """Return the command with the mistyped word corrected; None if no known word is similar to this word."""
    mistyped_word, suggestion_note = str(cause.figures.get("value", "")), cause.figures.get("suggestion")
    suggestion = suggestion_note.figures.get("match") if isinstance(suggestion_note, Diagnostic) else None
    for k, arg in enumerate(args):
        if (
            mistyped_word
            and suggestion is not None
            and mistyped_word in (arg, *arg.split(":"), *arg.split("="), Path(arg).name)
        ):
            return [*args[:k], arg.replace(mistyped_word, str(suggestion), 1), *args[k + 1 :]]
    return None


def _with_decimal_points(args: list[str]) -> list[str]:
    """Return the command with decimal points in numbers such as 0,3 and KEY=0,3, but not after --bound."""
    previous_args = ["", *args]
    return [
        arg.replace(",", ".")
        if option != "--bound" and DECIMAL_COMMA.fullmatch(arg.rpartition("=")[2])
        else arg
        for option, arg in zip(previous_args, args, strict=False)
    ]


def _nearest_file(missing_path: Path) -> Path | None:
    """Return the file in the same folder with the most similar name; None without a similar name."""
    close_names = difflib.get_close_matches(
        missing_path.name, _file_names(missing_path.parent), n=1, cutoff=MIN_SIMILARITY
    )
    return missing_path.parent / close_names[0] if close_names else None


def _sibling_files(path: Path) -> Diagnostic:
    """Return a message with the files of the same type in the folder of a missing path."""
    same_kind_names = [name for name in _file_names(path.parent) if Path(name).suffix == path.suffix]
    folder = path.parent.resolve().name
    if not same_kind_names:
        return fault("next.no-file", folder=folder, suffix=path.suffix)
    if len(same_kind_names) > MAX_LISTED_FILES:
        return fault(
            "next.files-and-more",
            folder=folder,
            files=same_kind_names[:MAX_LISTED_FILES],
            count=len(same_kind_names) - MAX_LISTED_FILES,
        )
    return fault("next.files", folder=folder, files=same_kind_names)


def _file_names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.glob("*") if p.is_file() and not p.name.startswith("."))


def advise_after_import(
    runs: "list[Run]", paths: list[Path], out: Path | None, vehicle_file: "VehicleFile | None", folder: str
) -> None:
    """Print the command that fits the runs: to the vehicle of the user, or else to one that `new` makes before."""
    first, *last = (path.stem if out is None else str(path) for path in paths)
    if not any(run.applied_commands.any() for run in runs):
        noise = baqueano_command("runs", "noise", first, *options.runs_option(folder))
        calibrate = baqueano_command("runs", "calibrate", first, *options.runs_option(folder))
        return print_message(note("cli.next-without-command", fix=noise, calibrate=calibrate))
    runs_and_options = [first, *(["--held-out", *last] if last else [])]
    is_new = vehicle_file is None and not options.DEFAULT_FILE.exists()
    usual_options = ["--vehicle", "mylab/vehicle.toml"] if is_new else []
    usual_options += (
        options.vehicle_and_runs_options(vehicle_file, folder)
        if vehicle_file
        else options.runs_option(folder)
    )
    fit = baqueano_command("identify", *runs_and_options, *usual_options, "--update")
    if not is_new:
        return print_message(note("cli.next-command", fix=fit))
    kind = ["--vehicle", "car"] if runs[0].applied_commands.shape[1] == CAR_COMMANDS else []
    return print_message(note("cli.next-new", fix=fit, cd=baqueano_command("new", "mylab", *kind)))


def run_options(folder: str, run: "Run", is_in_run: bool = False) -> list[str]:
    """Return the options of `vehicle_and_runs_options` if only a run is known, but not its vehicle file.

    A command that can use the vehicle file in the run (`is_in_run`) does not need a vehicle option then.
    """
    is_known = options.DEFAULT_FILE.exists() or (is_in_run and run.vehicle_text)
    return ([] if is_known else _vehicle_option(run)) + options.runs_option(folder)


def _vehicle_option(run: "Run") -> list[str]:
    """Return the option for the vehicle file of this folder, or of the garage, that belongs to a run.

    The option names FILE if no vehicle file, or more than one, belongs to the run. A run without
    a vehicle file belongs to a vehicle with as many commands.
    """
    from baqueano.vehicle_file.garage import names
    from baqueano.vehicle_file.text.toml_text import parse_toml

    def read_head(toml: str) -> tuple[object, int]:
        with suppress(ValueError):
            data = parse_toml(toml, "")
            return data.get("name"), len(data.get("command", {}).get("names", ()))
        return None, 0

    recorded_name, commands = read_head(run.vehicle_text)[0], run.applied_commands.shape[1]
    matching_files = []
    for path in sorted(Path().glob("*.toml")):
        name, n = read_head(path.read_text(encoding="utf-8", errors="replace"))
        if n == commands and recorded_name in (None, name):
            matching_files.append(str(path))
    if len(matching_files) == 1:
        return ["--vehicle", *matching_files]
    is_garage = not matching_files and recorded_name in names()
    return ["--vehicle", str(recorded_name) if is_garage else "FILE"]


def advise_to_fit(
    run_comparison: "Comparison", runs: "list[Run]", folder: str, run_names: list[str] | None = None
) -> None:
    """Print the command to type if the errors of an estimator in these runs are larger than its covariance states.
    `run_names` are the options of its vehicle, by default `run_options`.
    """
    for comparison, run in zip(run_comparison.runs, runs, strict=True):
        if comparison.is_overconfident:
            is_in_folder = run.path is None or run.path.parent == Path(folder)
            run_name = run.name if is_in_folder else run.path
            return print_message(
                note(
                    "cli.next-command",
                    fix=baqueano_command(
                        "identify",
                        run_name,
                        *(run_options(folder, run) if run_names is None else run_names),
                        "--update",
                    ),
                )
            )
