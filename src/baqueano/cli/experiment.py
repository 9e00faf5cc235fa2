"""baqueano experiment."""

from pathlib import Path
from typing import Any

import click
import numpy as np

from baqueano.cli import numbers, options
from baqueano.cli.terminal import answer, busy, clocked, talk


@click.command(help="Drive the vehicle with a signal that excites its dynamics; write a run.")
@options.vehicle
@options.robot
@click.option(
    "--signal",
    default="random-steps",
    show_default=True,
    help="random-steps, multisine, prbs, ramps; or designed, for this vehicle in this room.",
)
@click.option(
    "--room",
    metavar="WxH",
    help="Metres; the vehicle begins in the middle, heading along W, and stays inside. Of designed: 2x2.",
)
@click.option(
    "--known",
    is_flag=True,
    help="Design for the numbers of the file as they are; else a vehicle that was never fitted is driven "
    "carefully first, and fitted to that.",
)
@click.option("--seconds", type=numbers.seconds, default=60.0, show_default=True)
@options.seed
@options.backend
@options.runs_folder
@options.out
@options.as_json
def command(
    vehicle: str | None, settings: tuple[str, ...], robot: str, signal: str, room: str | None, known: bool,
    seconds: float, seed: int, backend: str, folder: str, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.drive import experiment
    from baqueano.runs.show import show

    file = options.load_vehicle(vehicle, settings)
    truth = options.load_truth(robot, file)
    if signal == "designed" and not known and not fitted(file):
        file = after_first_drive(file, truth, seed, backend, folder, out)
    u = signal_of(file, signal.replace("-", "_"), room, seconds, seed, backend)
    path = options.run_path(out, folder, "experiment")
    with clocked("experiment", seconds) as seen:
        run = experiment(file, u, truth=truth, seed=seed, backend=backend, path=path, progress=seen)
    talk(f"run: {path}")
    answer(show(run), as_json)
    options.ended(run, path)
    talk(f"next: baqueano identify {path.stem if out is None else path}")


def signal_of(file: Any, kind: str, size: str | None, seconds: float, seed: int, backend: str) -> np.ndarray:
    """The commands (N, n) of that name, kept in the room if there is one."""
    from baqueano.identify.design import contained, designed, room_of
    from baqueano.identify.signals import excitation

    if kind == "designed":
        room = room_of(file, size or "2x2")
        with busy("designing the experiment"):
            plan = designed(file, room, seconds, seed=seed, backend=backend)
        talk(plan.table())
        return plan.u
    u = excitation(kind, file.command.limit, seconds, file.rate_hz, seed)
    if size is None:
        return u
    with busy(f"keeping it in {size} m"):
        kept = contained(u, file, room_of(file, size), seed=seed, backend=backend)
    talk(
        f"room {size} m: {100.0 * kept.replaced:.0f} % of the signal replaced, the corridor of the body (3 standard "
        f"deviations) stays {100.0 * kept.margin_m:.1f} cm from the walls"
    )
    return kept.u


def fitted(file: Any) -> bool:
    """Whether any number of the model was ever measured on the vehicle."""
    return file.parameter_cov is not None or any(key.startswith("model.") for key in file.provenance)


def after_first_drive(file: Any, truth: Any, seed: int, backend: str, folder: str, out: Path | None) -> Any:
    """The file fitted to a careful first drive; AnswerNo where the vehicle is wired wrong or does not move."""
    from baqueano.drive import first_drive, rough
    from baqueano.identify import identify

    beside = None if out is None else out.with_name(f"{out.stem}-first{out.suffix}")
    path = options.run_path(beside, folder, "first-drive")
    talk(f"{file.name} was never fitted: small growing steps around one spot first (--known leaves them out)")
    with clocked("first drive", 0.0) as seen:
        first = first_drive(file, truth=truth, seed=seed, backend=backend, path=path, progress=seen)
    talk(f"run: {path}\n{first.table()}")
    options.ended(first.run, path)
    start = rough(first, file)
    with busy("fitting what it showed"):
        fit = identify([first.run], start, backend=backend)
    talk(f"{fit.verdict}: {'; '.join(fit.reasons)}")
    return start if fit.verdict == "REFUSED" else fit.vehicle_file
