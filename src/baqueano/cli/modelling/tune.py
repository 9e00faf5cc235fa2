"""Define `baqueano tune`: find the gains of the controller."""

from pathlib import Path

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import print_answer, print_message, show_activity
from baqueano.contracts.names import SHAPE_NAMES
from baqueano.diagnostics import Verdict, note
from baqueano.errors import AnswerNo, FileError
from baqueano.messages import texts
from baqueano.messages.printable import baqueano_command


@click.command(
    help="Find the gains of the controller on the identified model, along a shape or a stored route."
)
@options.vehicle
@click.option(
    "--route",
    "routes",
    multiple=True,
    default=["sinuous-circle"],
    show_default=True,
    metavar="SHAPE|NAME",
    help="Route to tune for: a shape, or a stored route. Repeat the option for gains that suit several routes.",
)
@options.speed_and_size
@click.option(
    "--controller",
    metavar="KIND|FILE:CLASS",
    help="Controller that replaces the controller of the vehicle file; --update also writes it.",
)
@click.option(
    "--estimator",
    "with_estimator",
    is_flag=True,
    help="Simulate with the estimator in the loop, and with noise.",
)
@click.option(
    "--draws",
    type=numbers.count_or_none,
    default=0,
    help="Number of vehicles to tune for, drawn from the covariance of the fit.",
)
@click.option(
    "--seeds",
    type=numbers.count,
    default=1,
    show_default=True,
    help="With --estimator: number of different sequences of noise for which the gains are tuned.",
)
@click.option(
    "--jerk",
    "jerk_m2",
    type=numbers.Number("m^2", excludes_low=False),
    default=0.1,
    show_default=True,
    help="Weight of changes of the command [m^2]; with 0 the command jumps between its limits.",
)
@click.option(
    "--effort",
    "effort_m2",
    type=numbers.Number("m^2", excludes_low=False),
    default=0.0,
    show_default=True,
    help="Weight of the command [m^2]: the cost of one tick with the command at its limit.",
)
@click.option(
    "--offset",
    "offset_m",
    type=numbers.Number("m", excludes_low=False),
    default=0.1,
    show_default=True,
    help="Distance behind and beside the route at the start of the drive [m]; 0 and --jerk 0 give the paper's cost.",
)
@click.option(
    "--radian",
    "radian_m",
    type=numbers.length,
    help=("Weight of an error of 1 rad in heading [m]; default: half the track."),
)
@options.seed
@options.backend
@options.update
@click.option(
    "-o", "--out", metavar="FILE", type=click.Path(path_type=Path, dir_okay=False),
    help="New vehicle file for the gains, instead of --update: the gains of the present file stay.",
)  # fmt: skip
@options.as_json
def command(
    vehicle: str | None, settings: tuple[str, ...], routes: tuple[str, ...], speed_m_s: float, size_m: float,
    controller: str | None, with_estimator: bool, draws: int, seeds: int, jerk_m2: float, effort_m2: float,
    offset_m: float, radian_m: float | None, seed: int, backend: str, update: bool, out: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    from baqueano.cli.driving.teach import shape_or_route
    from baqueano.runs.route_file import stored_routes
    from baqueano.tune import tune

    if not with_estimator:
        options.refuse_without("--estimator", "seeds")
    if out is not None:
        options.refuse_together("--out", "update")
        if out.exists():
            raise FileError.of("cli.file-exists", "-o FILE", path=out)
    vehicle_file = options.load_vehicle(vehicle, settings)
    options.advise_to_measure(vehicle_file)
    controller = options.block_kind(vehicle_file, "controller", controller)
    paths = [shape_or_route(route, speed_m_s, size_m) for route in routes]
    with show_activity(note("cli.tuning")):
        result = tune(
            vehicle_file,
            paths,
            controller=controller,
            radian_m=radian_m,
            jerk_m2=jerk_m2,
            effort_m2=effort_m2,
            offset_m=offset_m,
            estimator=with_estimator,
            draws=draws,
            seeds=seeds,
            seed=seed,
            backend=backend,
        )
    print_answer(result, as_json)
    if result.verdict == Verdict.REFUSED:
        raise AnswerNo.of("cli.tuning-refused", reasons="; ".join(texts(result.reasons)))
    if out is None:
        options.save_update(result.updated_file(), update)
    else:
        print_message(note("cli.written", path=result.updated_file().save(out)))
    if routes[0] in SHAPE_NAMES and (stored_names := stored_routes()):
        print_message(
            note(
                "cli.tuned",
                fix=baqueano_command("tune", "--route", stored_names[0]),
                route=routes[0],
                speed_m_s=speed_m_s,
            )
        )
