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
    default="sinuous-circle",
    show_default=True,
    metavar="SHAPE|NAME",
    help="What it is to drive: a shape, or a path that was taught.",
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
@click.option("--estimator", "with_estimator", is_flag=True, help="With the estimator in the loop and noise.")
@click.option(
    "--draws",
    type=numbers.count_or_none,
    default=0,
    help="Suit so many vehicles drawn from the covariance of the fit.",
)
@click.option(
    "--effort",
    "effort_m2",
    type=numbers.Number("m^2", above=False),
    default=0.1,
    show_default=True,
    help="Price of a jerky command [m^2]; without one, 0, the drive is mostly from limit to limit.",
)
@click.option(
    "--aside",
    "aside_m",
    type=numbers.Number("m", above=False),
    default=0.1,
    show_default=True,
    help="Start of the drive, behind and beside the route [m]; 0 with --effort 0 is the paper's cost.",
)
@click.option(
    "--radian", "radian_m", type=numbers.length, help="What a radian weighs [m]; default half the track."
)
@options.seed
@options.backend
@options.update
@options.as_json
def command(
    vehicle: str | None, settings: tuple[str, ...], route: str, speed_m_s: float, size_m: float,
    with_estimator: bool, draws: int, effort_m2: float, aside_m: float, radian_m: float | None, seed: int, backend: str,
    update: bool, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.cli.driving.teach import SHAPES, shape_or_route
    from baqueano.tune import tune

    file = options.load_vehicle(vehicle, settings)
    options.advise_to_measure(file)
    path = shape_or_route(route, speed_m_s, size_m)
    with busy(note("cli.tuning")):
        tuned = tune(
            file,
            path,
            radian_m=radian_m,
            effort_m2=effort_m2,
            aside_m=aside_m,
            estimator=with_estimator,
            draws=draws,
            seed=seed,
            backend=backend,
        )
    answer(tuned, as_json)
    options.kept(tuned.applied(), update)
    if route in SHAPES:
        talk(note("cli.tuned", fix="baqueano tune --route NAME", route=route, speed_m_s=speed_m_s))
