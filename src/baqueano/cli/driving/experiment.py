"""Define `baqueano experiment`: drive the vehicle with a signal that excites its dynamics."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from baqueano.cli import numbers, options
from baqueano.cli.driving.drive_options import DriveOptions, drive_options
from baqueano.cli.driving.iterate import drive_in_rounds
from baqueano.cli.driving.targets import Target, print_fault_detections
from baqueano.cli.page import live
from baqueano.cli.terminal import print_answer, print_message, show_activity, show_time_progress
from baqueano.diagnostics import Verdict, nearest, note
from baqueano.errors import UsageError
from baqueano.messages import texts
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile


@click.command(help="Drive the vehicle with a signal that excites its dynamics; write a run.")
@options.vehicle
@options.robot
@click.option(
    "--signal",
    default="random-steps",
    show_default=True,
    help=(
        "Signal of the command: random-steps, multisine, prbs, ramps; or designed, for this "
        "vehicle and this room."
    ),
)
@click.option(
    "--room",
    metavar="WIDTHxHEIGHT",
    help=(
        "Room [m]. The vehicle begins in the middle, heading along the width, and stays inside. Default "
        "of designed: 2x2."
    ),
)
@click.option(
    "--trust-file",
    is_flag=True,
    help=(
        "Use the numbers of the file. Without this option, a vehicle that was never fitted first makes a "
        "careful drive, and is fitted."
    ),
)
@click.option(
    "--rounds",
    type=numbers.count,
    help="With --signal designed, repeat drive, fit and new design this number of times.",
)
@options.seconds
@options.seed
@options.shake
@options.backend
@options.runs_folder
@options.out
@options.update
@live.page
@options.as_json
@drive_options
def command(
    drive: DriveOptions, signal: str, room: str | None, trust_file: bool, rounds: int | None, seconds: float,
    update: bool, as_json: bool,
) -> None:  # fmt: skip
    _check_options(signal, rounds, update)
    if signal != "designed":
        options.refuse_without("--signal designed", "trust_file")
    vehicle_file, seed, backend, out = drive.load_vehicle(), drive.seed, drive.backend, drive.out
    kind, run_names = signal.replace("-", "_"), []
    if room is not None:
        from baqueano.routes.room import vehicle_room

        vehicle_room(vehicle_file, room)  # before anything moves

    def round_path(label: str) -> Path:
        labelled_path = out.with_name(f"{out.stem}-{label}{out.suffix}") if out is not None and label else out
        path = options.run_path(
            labelled_path, drive.folder, label if label == "first-drive" else "experiment"
        )
        run_names.append(path.stem if out is None else str(path))
        return path

    with drive.open(vehicle_file) as target:
        runs: list[Run] = []
        if signal == "designed" and not trust_file and vehicle_file.is_guess:
            vehicle_file, first_result = make_first_drive(vehicle_file, target, backend, round_path)
            runs.append(first_result)
            target.return_to_middle()
        if rounds is not None:
            make_signal = lambda now, draw: build_signal(now, kind, room, seconds, draw, backend)  # noqa: E731
            result = drive_in_rounds(
                vehicle_file, target, runs, rounds, make_signal, seed, backend, round_path
            )
            print_answer(result, as_json)
            options.save_update(result.rounds[-1].fit.vehicle_file, update)
        else:
            u = build_signal(vehicle_file, kind, room, seconds, seed, backend)
            run_experiment(vehicle_file, target, u, round_path(""), as_json, drive.shake)
    print_message(
        note(
            "cli.next-command",
            fix=baqueano_command(
                "identify",
                *run_names,
                *options.vehicle_and_runs_options(vehicle_file, drive.folder),
                "--update",
            ),
        )
    )


def run_experiment(
    vehicle_file: "VehicleFile",
    target: Target,
    u: np.ndarray,
    path: Path,
    as_json: bool,
    shake: tuple[str, ...] = (),
) -> None:
    """Drive the commands `u` (N, n), store the run at `path`, and show it."""
    from baqueano.drive.mission import Mission
    from baqueano.runs.show import show

    with show_time_progress(note("cli.experiment"), len(u) / vehicle_file.rate_hz) as progress:
        run = target.drive(Mission("experiment", u=u), vehicle_file, path, progress)
    print_message(note("cli.run", path=path))
    print_fault_detections(run, vehicle_file, shake)
    print_answer(show(run), as_json)
    options.raise_stop(run, path, are_warnings_printed=not as_json)


def _check_options(signal: str, rounds: int | None, update: bool) -> None:
    """Raise UsageError if the options conflict."""
    from baqueano.simulate.excitation import KINDS

    kinds = [kind.replace("_", "-") for kind in (*KINDS, "designed")]
    if signal.replace("_", "-") not in kinds:
        raise UsageError.of("cli.signal-unknown", value=signal, suggestion=nearest(signal, kinds))
    if rounds is not None and signal != "designed":
        raise UsageError.of("cli.rounds-without-designed", "--signal designed", rounds=rounds, signal=signal)
    if update and rounds is None:
        raise UsageError.of("cli.update-without-rounds", "--signal designed --rounds 3 --update")


def build_signal(
    vehicle_file: "VehicleFile", kind: str, size: str | None, seconds: float, seed: int, backend: str
) -> np.ndarray:
    """Return the commands (N, n) of this kind of signal.

    The vehicle stays in the room `size`, if given. A designed signal always has a room, by default "2x2".
    """
    from baqueano.design.containment import contain_in_room
    from baqueano.design.plan import design_plan
    from baqueano.routes.room import vehicle_room
    from baqueano.simulate.excitation import excitation

    if kind == "designed":
        room = vehicle_room(vehicle_file, size or "2x2")
        with show_activity(note("cli.designing")) as say:
            plan = design_plan(vehicle_file, room, seconds, seed=seed, backend=backend, progress=say)
        print_message(plan.table())
        return plan.u
    u = excitation(kind, vehicle_file.command.limit, seconds, vehicle_file.rate_hz, seed)
    if size is None:
        return u
    room = vehicle_room(vehicle_file, size)
    with show_activity(note("cli.planning-in-room", size=size)):
        containment = contain_in_room(u, vehicle_file, room, seed=seed, backend=backend)
    print_message(
        note(
            "cli.room-replaced",
            size=size,
            percent=100.0 * containment.replaced_fraction,
            margin_cm=100.0 * containment.margin_m,
        )
    )
    return containment.u


def make_first_drive(
    vehicle_file: "VehicleFile", target: Target, backend: str, round_path: Callable[[str], Path]
) -> tuple[Any, Any]:
    """Return the file fitted to a careful first drive, and the run of that drive.

    If the fit is refused, the file has only rough gains. Raise AnswerNo if the vehicle is wired wrongly or does not
    move, and the error of a stopped drive.
    """
    from baqueano.design.vehicle_cloud import planning_file
    from baqueano.drive import estimate_first_drive, with_rough_gains
    from baqueano.drive.mission import Mission
    from baqueano.identify import FitOptions, identify

    path = round_path("first-drive")
    print_message(note("cli.first-drive", name=vehicle_file.name))
    with show_time_progress(note("cli.driving-first"), 0.0) as progress:
        first_result = estimate_first_drive(
            target.drive(Mission("first drive"), vehicle_file, path, progress), vehicle_file
        )
    print_message(note("cli.run", path=path))
    print_message(first_result.table())
    options.raise_stop(first_result.run, path)
    rough_file = with_rough_gains(first_result, vehicle_file)
    with show_activity(note("cli.fitting-first")):
        fit = identify([first_result.run], rough_file, options=FitOptions(backend=backend))
    slow = next((reason for reason in fit.reasons if reason.code == "fit.speed-unknown"), None)
    reasons = [reason for reason in fit.reasons if reason is not slow]
    if reasons:
        print_message(note("cli.fitted", verdict=fit.verdict, reasons="; ".join(texts(reasons))))
    if slow is not None and fit.verdict != Verdict.REFUSED:
        print_message(note("cli.first-drive-slow", names=slow.figures["names"]))
    return planning_file(fit, rough_file), first_result.run
