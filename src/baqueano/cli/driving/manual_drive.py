"""Drive manually from this terminal, in real time, for `drive` and `teach --driver keys`."""

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from baqueano.cli import options
from baqueano.cli.driving.drive_options import DriveOptions
from baqueano.cli.driving.targets import LOCAL_TARGETS, open_target
from baqueano.cli.page.live import live_page
from baqueano.cli.terminal import print_message
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import Diagnostic, StopReason, note, stop as because
from baqueano.errors import AnswerNo, UsageError
from baqueano.messages.printable import baqueano_command

if TYPE_CHECKING:
    from baqueano.drive.manual.cockpit import Cockpit
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

ANY_PAD = ""  # --pad without a name

pad_option = click.option(
    "--pad", is_flag=False, flag_value=ANY_PAD, metavar="[DEVICE]",
    help="Game pad of this computer; the first one, or the one named here: /dev/input/event5.",
)  # fmt: skip
hold_option = click.option(
    "--no-hold", "hold", flag_value=False, default=True,
    help="Do not correct the heading with the gyro while you drive straight.",
)  # fmt: skip


def drive_manually(
    verb: str, vehicle_file: "VehicleFile", drive: DriveOptions, path: Path, pad: str | None = None, *, hold: bool,
    **options: Any,
) -> "Run":  # fmt: skip
    """Return the run of a manual drive in real time, which ends with q.

    `verb` is "drive" or "teach". `pad` is the device of the game pad, or ANY_PAD to search for it. With `hold` and a
    gyro, the heading is kept during straight motion. `options` contains `command_share` and `latched` of a Cockpit.
    Raise UsageError for an emulated vehicle.
    """
    from baqueano.drive.manual.cockpit import Cockpit
    from baqueano.drive.manual.heading_gains import heading_hold_gains
    from baqueano.drive.manual.pad import find_pad
    from baqueano.drive.manual.tty import is_over_ssh, terminal_proxy
    from baqueano.drive.mission import Mission
    from baqueano.runs import read_run

    kind = drive.kind
    if kind == "emulated":
        raise UsageError.of("cli.emulated-manual", "--robot simulated")
    device = None if pad is None else find_pad(Path(pad) if pad != ANY_PAD else None)
    if device is not None:
        print_message(note("cli.game-pad", name=device.name))
    multiplexer = terminal_proxy() if is_over_ssh(os.environ) else ""
    if multiplexer:
        print_message(note("cli.terminal-hidden", program=multiplexer))
    with ExitStack() as resources:
        target: Any = resources.enter_context(
            open_target(drive.robot, vehicle_file, drive.seed, drive.backend)
        )
        cockpit = Cockpit(
            vehicle_file.command.limit, name=drive.robot, names=tuple(vehicle_file.command.names),
            has_heartbeat=not multiplexer, hold=hold and heading_hold_gains(vehicle_file) is not None, pad=device,
            drivetrain=getattr(vehicle_file.vehicle, "drivetrain", None), **options,
        )  # fmt: skip
        hand = resources.enter_context(cockpit)
        resources.enter_context(stop_on_signals(hand.stop))
        arguments = simulation_options(vehicle_file, drive, hand) if kind == "simulated" else {}
        arguments |= (
            {"words": hand.pop_messages, "on_state": hand.show, "on_event": hand.show_message}
            if kind != "simulated"
            else {}
        )
        run = target.drive(
            Mission(verb, hold=hold), vehicle_file, path, lambda seconds: None, hand=hand, **arguments
        )
    return read_run(path) if kind == "simulated" else run  # a live drive does not contain a run


def drive_on_page(
    verb: str, vehicle_file: "VehicleFile", drive: DriveOptions, path: Path, *, hold: bool
) -> "Run":
    """Return the run of a manual drive, as `drive_manually`, from the page instead of this terminal."""
    from baqueano.drive.mission import Mission
    from baqueano.runs import read_run

    with (
        live_page(
            drive.show_page, drive.robot, vehicle_file, drive.folder, drive.pace, is_manual=True
        ) as page,
        open_target(drive.robot, vehicle_file, drive.seed, drive.backend, page) as target,
    ):
        assert page is not None
        with stop_on_signals(page.door.operator.stop):
            page.wait_for_hand()
            is_local = drive.kind in LOCAL_TARGETS
            arguments = {"live": True} if is_local else {}
            hand = partial(page.door.hand, len(vehicle_file.command.names))
            mission = Mission(verb, hold=hold)
            run = target.drive(mission, vehicle_file, path, lambda seconds: None, hand=hand, **arguments)
    return read_run(path) if is_local else run  # a live drive does not contain a run


def simulation_options(vehicle_file: "VehicleFile", drive: DriveOptions, hand: "Cockpit") -> JsonObject:
    """Return the options of a simulated drive in real time."""
    from baqueano.worlds import SimulatedWorld
    from baqueano.worlds.clock import wall

    truth = options.load_truth(drive.robot, vehicle_file)
    world = SimulatedWorld(truth.vehicle, truth.sensors, truth.rate_hz, drive.seed, backend=drive.backend)
    hand.status.state = "simulated"
    return {
        "world": world, "tick_times_ns": relative_ticks(wall(vehicle_file.rate_hz)), "live": True,
        "observers": (hand,),
    }  # fmt: skip


def relative_ticks(clock: Iterable[int]) -> Iterator[int]:
    """Yield the ticks of `clock` minus the first one, because the time of a simulated world begins at 0."""
    start_ns = None
    for t_ns in clock:
        start_ns = t_ns if start_ns is None else start_ns
        yield t_ns - start_ns


@contextmanager
def stop_on_signals(stop: Callable[[Diagnostic], object]) -> Iterator[None]:
    """Stop the vehicle by `stop` if the terminal hangs up or another process ends the program."""
    previous_handlers = {}

    def stop_by_signal(number: int, frame: FrameType | None) -> None:
        is_terminated = number == signal.SIGTERM
        stop(because(StopReason.PROGRAM_ENDED if is_terminated else StopReason.TERMINAL_CLOSED))

    for name in ("SIGHUP", "SIGTERM"):
        if hasattr(signal, name):
            previous_handlers[name] = signal.signal(getattr(signal, name), stop_by_signal)
    try:
        yield
    finally:
        for name, handler in previous_handlers.items():
            signal.signal(getattr(signal, name), handler)


def finish_manual_drive(run: "Run", path: Path, robot: str) -> None:
    """Raise the error of a stopped drive, except if its driver ended it."""
    from baqueano.drive import drive_stop_reason

    stop_reason = drive_stop_reason(run)
    if stop_reason is not None and stop_reason.code == StopReason.INTERRUPTED:
        return
    if stop_reason is not None and robot.partition(":")[0] != "simulated":
        print_message(note("cli.stop-latched", fix=baqueano_command("robot", "clear", robot)))
    options.raise_stop(run, path)


def mark_scales(
    run: "Run", vehicle_file: "VehicleFile", length_m: float | None = None
) -> tuple[Diagnostic | str, dict[str, object]]:
    """Return the scales of the sensors that the marks of a run determine, as text and as values of the vehicle file.

    If the marks do not determine a scale, the text is the reason, and the values are {}.
    """
    from baqueano.drive.closure import closure
    from baqueano.drive.session import mark_times_ns

    if len(mark_times_ns(run)) < 2:
        return note("cli.marks-too-few"), {}
    try:
        result = closure(run, vehicle_file, length_m)
    except AnswerNo as error:
        return note("cli.marks", cause=error.diagnostic), {}
    return result.table(), result.values


def lap_scale(run: "Run", vehicle_file: "VehicleFile") -> tuple[Diagnostic | str, dict[str, object]]:
    """Return the gyro scale that a lap back to its start determines, as text and as values of the vehicle file.

    A file without an identified model cannot compute the end of the lap; then only the marks count.
    """
    from baqueano.drive.closure import lap_closure

    if vehicle_file.is_guess:
        return mark_scales(run, vehicle_file)
    try:
        result = lap_closure(run, vehicle_file)
    except AnswerNo as error:
        return note("cli.marks", cause=error.diagnostic), {}
    return result.table(), result.values
