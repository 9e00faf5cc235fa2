"""baqueano tune."""

import click

from baqueano.cli import numbers, options
from baqueano.cli.terminal import answer, busy, talk
from baqueano.diagnostics import note


@click.command(
    help="Find the gains of the controller on the identified model, along a shape or a stored route."
)
@options.vehicle
@click.option(
    "--route",
    "routes",
    multiple=True,
    default=["sinuous-circle"],
    show_default="sinuous-circle",
    metavar="SHAPE|NAME",
    help="What it is to drive: a shape, or a path that was taught; give it several times for gains that suit all.",
)
@click.option(
    "--speed", "speed_m_s", type=numbers.speed, default=0.25, show_default=True, help="Along a shape [m/s]."
)
@click.option(
    "--size",
    "size_m",
    type=numbers.length,
    default=1.0,
    show_default=True,
    help="Radius of a circle, half length of an eight [m].",
)
@click.option(
    "--controller",
    metavar="KIND|FILE:CLASS",
    help="Another controller than the file's; --update writes it too.",
)
@click.option("--estimator", "with_estimator", is_flag=True, help="With the estimator in the loop and noise.")
@click.option(
    "--draws",
    type=numbers.count_or_none,
    default=0,
    help="Suit so many vehicles drawn from the covariance of the fit.",
)
@click.option(
    "--seeds",
    type=numbers.count,
    default=1,
    show_default=True,
    help="Suit so many draws of the noise, with --estimator.",
)
@click.option(
    "--jerk",
    "jerk_m2",
    type=numbers.Number("m^2", above=False),
    default=0.1,
    show_default=True,
    help="Price of a jerky command [m^2]; without one, 0, the drive is mostly from limit to limit.",
)
@click.option(
    "--effort",
    "effort_m2",
    type=numbers.Number("m^2", above=False),
    default=0.0,
    show_default=True,
    help="Price of a tick at the limit of the command [m^2].",
)
@click.option(
    "--aside",
    "aside_m",
    type=numbers.Number("m", above=False),
    default=0.1,
    show_default=True,
    help="Start of the drive, behind and beside the route [m]; 0 with --jerk 0 is the paper's cost.",
)
@click.option(
    "--radian", "radian_m", type=numbers.length, help="What a radian weighs [m]; default half the track."
)
@options.seed
@options.backend
@options.update
@options.as_json
def command(
    vehicle: str | None, settings: tuple[str, ...], routes: tuple[str, ...], speed_m_s: float, size_m: float,
    controller: str | None, with_estimator: bool, draws: int, seeds: int, jerk_m2: float, effort_m2: float,
    aside_m: float, radian_m: float | None, seed: int, backend: str, update: bool, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.cli.driving.teach import SHAPES, shape_or_route
    from baqueano.tune import tune

    file = options.load_vehicle(vehicle, settings)
    options.advise_to_measure(file)
    controller = options.own_block(file, "controller", controller)
    paths = [shape_or_route(route, speed_m_s, size_m) for route in routes]
    with busy(note("cli.tuning")):
        tuned = tune(
            file,
            paths,
            controller=controller,
            radian_m=radian_m,
            jerk_m2=jerk_m2,
            effort_m2=effort_m2,
            aside_m=aside_m,
            estimator=with_estimator,
            draws=draws,
            seeds=seeds,
            seed=seed,
            backend=backend,
        )
    answer(tuned, as_json)
    options.kept(tuned.applied(), update)
    if routes[0] in SHAPES:
        talk(note("cli.tuned", fix="baqueano tune --route NAME", route=routes[0], speed_m_s=speed_m_s))
