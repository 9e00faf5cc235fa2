"""Define `baqueano simulate`: drive simulated vehicles with a signal."""

from dataclasses import replace
from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import print_answer, print_message, show_activity
from baqueano.diagnostics import note


@click.command(help="Simulate one vehicle, or thousands, with a signal; write a run.")
@options.vehicle
@click.option(
    "--signal",
    default="random-steps",
    show_default=True,
    help=("Signal of the command: random-steps, multisine, prbs or ramps."),
)
@options.seconds
@click.option(
    "--vehicles",
    type=numbers.count,
    default=1,
    show_default=True,
    help="Number of vehicles; more than 1 are drawn from the covariance of the fit.",
)
@click.option(
    "--model",
    is_flag=True,
    help=("Simulate the model of the file itself, even if [simulation] names another vehicle."),
)
@options.seed
@options.backend
@options.runs_folder
@options.out
@options.as_json
def command(
    vehicle: str | None, settings: tuple[str, ...], signal: str, seconds: float, vehicles: int, model: bool, seed: int,
    backend: str, folder: str, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.runs import write_run
    from baqueano.runs.show import show
    from baqueano.simulate import simulate, simulate_many
    from baqueano.simulate.excitation import excitation

    if vehicles > 1:
        options.refuse_together("--vehicles", "out", "model")
    vehicle_file = options.load_vehicle(vehicle, settings)
    u = excitation(signal.replace("-", "_"), vehicle_file.command.limit, seconds, vehicle_file.rate_hz, seed)
    if vehicles > 1:
        with show_activity(note("cli.simulating-many", vehicles=vehicles)):
            simulations = simulate_many(
                vehicle_file, u, vehicles, seed=seed, every_s=seconds / 10, backend=backend
            )
        print_answer(simulations, as_json)
        return
    simulated_file = vehicle_file if model else vehicle_file.truth
    if simulated_file is not vehicle_file:
        print_message(
            note("cli.simulated-truth", vehicle=vehicle_file.label, truth=vehicle_file.simulation.truth)
        )
    with show_activity(note("cli.simulating", seconds=seconds)):
        run = replace(simulate(simulated_file, u, seed, backend=backend), vehicle_text=vehicle_file.text)
        path = write_run(run, options.run_path(out, folder, "simulation"))
    print_message(note("cli.run", path=path))
    print_answer(show(options.find_runs((str(path),), folder)[0]), as_json)
