"""baqueano identify."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import answer, busy, talk


@click.command(help="Fit the model, and the noise, to one or more RUNS: by number, name, path, or 'last'.")
@click.argument("runs", nargs=-1, required=True)
@options.vehicle
@click.option(
    "--free", multiple=True, metavar="KEY", help="Parameter to fit; default: what the vehicle's kind needs."
)
@click.option("--fix", multiple=True, metavar="KEY", help="Parameter to leave as it is.")
@click.option("--bound", multiple=True, metavar="KEY=LOW,HIGH", help="Range of a parameter.")
@click.option(
    "--use",
    multiple=True,
    metavar="SENSOR",
    help="Sensor to fit to, or one channel of it as imu[2]; default: all that the runs hold.",
)
@click.option("--no-noise", is_flag=True, help="Leave the noise covariances of the file as they are.")
@options.backend
@options.runs_folder
@options.update
@options.page
@options.as_json
def command(
    runs: tuple[str, ...], vehicle: str | None, settings: tuple[str, ...], free: tuple[str, ...],
    fix: tuple[str, ...], bound: tuple[str, ...], use: tuple[str, ...], no_noise: bool, backend: str,
    folder: str, update: bool, page: Path | None, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.errors import AnswerNo
    from baqueano.identify import identify
    from baqueano.identify.noise import measure_noise

    recorded = options.find_runs(runs, folder)
    file = options.load_vehicle(vehicle, settings)
    limits = dict(map(bounded, bound))
    with busy(
        f"fitting {len(recorded)} run{'s' * (len(recorded) > 1)}, {sum(r.duration_s for r in recorded):.0f} s"
    ):
        fit = identify(
            recorded, file, free or None, fixed=fix, bounds=limits, use=use or None, backend=backend
        )
    answer(fit, as_json)
    if page is not None:
        from baqueano.report.of_fit import page_of_fit

        with busy("drawing the figures"):
            written = page_of_fit(fit).save(page)
        talk(f"report: {written}")
    if fit.verdict == "REFUSED":
        raise AnswerNo("the fit is refused, and the vehicle file stays as it is: " + "; ".join(fit.reasons))
    fitted = fit.vehicle_file
    if not no_noise and fitted.data.get("estimator"):
        with busy("measuring the noise"):
            noise = measure_noise(fit, recorded, backend=backend)
        talk(noise.table())
        fitted = noise.updated(fitted, ", ".join(fit.runs))
    options.kept(fitted, update)


def bounded(said: str) -> tuple[str, tuple[float, float]]:
    """("model.friction.linear", (0, 10)) from "model.friction.linear=0,10"."""
    from baqueano.errors import UsageError

    key, _, limits = said.partition("=")
    try:
        low, high = (float(x) for x in limits.split(","))
    except ValueError as error:
        raise UsageError(f"--bound {said}: expected KEY=LOW,HIGH. Type: --bound {key}=0,10") from error
    return key, (low, high)
