"""baqueano experiment."""

from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import answer, clocked, talk


@click.command(help="Drive the vehicle with a signal that excites its dynamics; write a run.")
@options.vehicle
@options.robot
@click.option(
    "--signal", default="random-steps", show_default=True, help="random-steps, multisine, prbs or ramps."
)
@click.option("--seconds", type=numbers.seconds, default=60.0, show_default=True)
@options.seed
@options.backend
@options.runs_folder
@options.out
@options.as_json
def command(
    vehicle: str | None, settings: tuple[str, ...], robot: str, signal: str, seconds: float, seed: int,
    backend: str, folder: str, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.drive import experiment
    from baqueano.identify.signals import excitation
    from baqueano.runs.show import show

    file = options.load_vehicle(vehicle, settings)
    truth = options.load_truth(robot, file)
    u = excitation(signal.replace("-", "_"), file.command.limit, seconds, file.rate_hz, seed)
    path = options.run_path(out, folder, "experiment")
    with clocked("experiment", seconds) as seen:
        run = experiment(file, u, truth=truth, seed=seed, backend=backend, path=path, progress=seen)
    talk(f"run: {path}")
    answer(show(run), as_json)
    options.ended(run, path)
    talk(f"next: baqueano identify {path.stem if out is None else path}")
