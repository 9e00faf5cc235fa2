"""Define `baqueano identify`: fit the model and the noise to runs."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from baqueano.cli import numbers, options
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.terminal import print_answer, print_message, print_result, show_activity, show_steps
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, Verdict, fault, note
from baqueano.errors import AnswerNo, Interruption, UsageError
from baqueano.messages import group_sentences, json_row, text
from baqueano.messages.notation import OPTIONS

if TYPE_CHECKING:
    from baqueano.guides.route import Route
    from baqueano.identify.result.fit_result import Fit
    from baqueano.runs.run import Run
    from baqueano.vehicle_file.file import VehicleFile

PLAIN_FIT_ARGUMENTS = ("per_run", "clocks", "segment_s", "speed_noise", "cost", "measured")
GROUPS = {
    "Parameters": ("free", "fix", "bound", "per_run"),
    "Data": ("use", "segment", "clock", "measured", "tolerance"),
    "Method": ("cost", "speed_noise", "choose", "parameter_history"),
    "Evaluation": ("held_out", "route"),
    "Results": ("update", "no_noise", "table", "page", "figures", "file_format", "width", "as_json"),
}


@click.command(
    cls=options.GroupedCommand,
    groups=GROUPS,
    help="Fit the model, and the noise, to one or more RUNS: by number, name, path, or 'last'.",
)
@click.argument("runs", nargs=-1, required=True)
@options.vehicle
@click.option(
    "--free",
    multiple=True,
    metavar="[+]KEY",
    help="Parameter to estimate. KEY replaces the default set; +KEY adds to that set, or to each KEY without +.",
)
@click.option("--fix", multiple=True, metavar="KEY", help="Parameter to keep fixed.")
@click.option("--bound", multiple=True, metavar="KEY=LOW,HIGH", help="Lower and upper bound of a parameter.")
@click.option(
    "--use",
    multiple=True,
    metavar="SENSOR",
    help=(
        "Sensor to use in the fit, or one of its channels, imu[2]; 'truth' is a camera; "
        "default: all sensors of the runs."
    ),
)
@click.option("--per-run", multiple=True, metavar="KEY", help="Parameter with its own value in each run.")
@click.option(
    "--clock", multiple=True, metavar="SENSOR", help="Sensor whose clock offset is estimated, one per run."
)
@click.option(
    "--segment",
    type=numbers.Number("s"),
    help="Split each run into segments of this length [s] (multiple shooting).",
)
@click.option(
    "--cost",
    type=click.Choice(["simulation", "innovations"]),
    default="simulation",
    help=(
        "Error to minimise: of the simulation, or of one-step predictions (innovations; for a "
        "floor that disturbs the vehicle)."
    ),
)
@click.option("--speed-noise", is_flag=True, help="Let the noise grow with the speed.")
@click.option(
    "--choose",
    is_flag=True,
    help="Start from the smallest model, and add the terms that lower the error on held-out data.",
)
@click.option(
    "--over-time",
    "parameter_history",
    is_flag=True,
    help="Estimate the parameters run by run, and report their drift.",
)
@click.option(
    "--held-out", multiple=True, metavar="RUN", help="Run to test the fit with; it is not used in the fit."
)
@click.option(
    "--measured",
    multiple=True,
    metavar='"TIME: LENGTH, ANGLE"',
    help='Distance and angle from the start, measured by tape: "12.4 s: 2.31 m", "end: 0 m, 720 deg".',
)
@click.option(
    "--tolerance",
    multiple=True,
    metavar="KEY=FRACTION",
    help=(
        "Relative error of a scale of the IMU, for a car without another speed sensor: "
        "sensors.imu.gyro_scale=0.01."
    ),
)
@click.option(
    "--route",
    metavar="SHAPE|NAME",
    help="Route of the forecast; default: a sinuous circle at the speed of the runs.",
)
@click.option("--no-noise", is_flag=True, help="Keep the noise covariances of the file.")
@options.backend
@options.runs_folder
@options.update
@report_options
@options.as_json
def command(
    runs: tuple[str, ...], vehicle: str | None, settings: tuple[str, ...], choose: bool,
    parameter_history: bool, held_out: tuple[str, ...], no_noise: bool, folder: str, update: bool,
    report: ReportFiles, as_json: bool, backend: str, **arguments: Any,
) -> None:  # fmt: skip
    from baqueano.identify import identify
    from baqueano.runs.diagnostics.cleaning import unused_sensors

    _check_options(parameter_history, choose, with_validation=bool(held_out))
    lap = _forecast_route(arguments["route"])
    fit_runs, validation_runs = (options.find_runs(names, folder) for names in (runs, held_out))
    fit_settings: JsonObject = _fit_arguments(arguments, backend)
    named_keys = [key for key in arguments["free"] if not key.startswith("+")]
    if 0 < len(named_keys) < len(arguments["free"]):
        print_message(note("cli.free-mixed", names=named_keys))
    vehicle_file = _with_tolerances(
        options.load_vehicle(vehicle, settings), arguments["tolerance"], fit_runs, fit_settings
    )
    if not fit_settings["use"]:
        for diagnostic in unused_sensors(fit_runs, vehicle_file):
            print_message(diagnostic)
    if parameter_history:
        return _fit_drift(fit_runs, vehicle_file, fit_settings, report, update, as_json)
    span_s = sum(r.duration_s for r in fit_runs)
    with show_steps() as begin:
        progress_line = begin(note("cli.fitting-span", runs=len(fit_runs), span_s=span_s))
        progress_line.text = text(note("cli.translating"))
        result: Any = (
            _select_terms(fit_runs, vehicle_file, fit_settings, validation_runs, begin)
            if choose
            else identify(fit_runs, vehicle_file, progress=progress_line, **fit_settings)
        )
    fit, validation = result.fit if choose else result, None
    if validation_runs and fit.verdict != Verdict.REFUSED:
        start_file, changes = (fit.vehicle_file, result.refit_arguments) if choose else (vehicle_file, {})
        changed_settings = fit_settings | changes
        fit, validation = _validate_fit(fit, fit_runs, validation_runs, start_file, changed_settings)
        result = replace(result, fit=fit) if choose else fit
    drive_forecast = _forecast_drive(fit, fit_runs, lap, arguments["route"])
    if as_json or report.page is None:
        print_answer(
            result, as_json, _extra_rows(fit, validation), forecast=drive_forecast.rows() if drive_forecast else [],
            findings=list(map(json_row, fit.findings)),
        )  # fmt: skip
    else:
        print_result(result.table(reported=True))
    for result_part in filter(None, (validation, drive_forecast) if not as_json else ()):
        print_result(result_part.table())
    _write_table(report, fit, vehicle_file, f"{vehicle_file.name}, from {', '.join(fit.runs)}")
    if report:
        from baqueano.report.fit_report import fit_page

        report.write(
            lambda: fit_page(fit, held_out=validation, drive_forecast=drive_forecast), reproducible=True
        )
    if progress_line.stopped:
        raise Interruption.of("cli.fit-interrupted")
    _check_verdicts(fit, validation, update, report.page)
    output = fit.vehicle_file
    if not no_noise:
        noise = _measured_noise(fit, fit_runs, validation_runs, backend)
        output = noise.updated_file(output, ", ".join(fit.runs))
    options.save_update(output, update, *next_words(drive_forecast, arguments["route"]))


def next_words(drive_forecast: Any, route: str | None) -> list[str]:
    """Return the words of the next command. A model that leaves a lap at the speed of its own runs needs more data."""
    codes = {getattr(message, "code", "") for message in drive_forecast.notes} if drive_forecast else set()
    if "forecast.strays" in codes and route is None:
        return ["experiment", "--signal", "designed", "--rounds", "3", "--update"]
    return ["tune", "--update"]


def _check_options(parameter_history: bool, choose: bool, *, with_validation: bool) -> None:
    """Raise UsageError if an option conflicts with `parameter_history`."""
    if parameter_history and (choose or with_validation):
        conflict = "--choose" if choose else "--held-out"
        raise UsageError.of("cli.options-conflict", second_option=conflict)


def _check_verdicts(fit: "Fit", validation: Any, update: bool, page: Path | None) -> None:
    """Raise AnswerNo for a refused fit or validation. For `update`, also raise it if the gains contradict the file."""
    from baqueano.identify.diagnostics.file_consistency import GAIN_CODES

    for code, outcome in (("cli.fit-refused", fit), ("cli.fit-refused-held-out", validation)):
        if outcome is not None and outcome.verdict == Verdict.REFUSED:
            raise AnswerNo(_refusal(code, outcome.reasons, page))
    if update and (contradictions := [reason for reason in fit.reasons if reason.code in GAIN_CODES]):
        raise AnswerNo(_refusal("cli.fit-mirrored", contradictions, page))


def _refusal(code: str, reasons: Sequence[Diagnostic], page: Path | None) -> Diagnostic:
    """Return the reason why a fit is refused, with a hint to the report on `page` or to the option for a report."""
    data = note("cli.data-advice", fix="--report fit.html") if page is None else note("cli.data-in-report")
    return fault(code, reasons="; ".join(group_sentences(reasons)[:2]), data=data)


def _forecast_route(route: str | None) -> "Route | None":
    """Return the route of the forecast, or None if the runs give the speed. Raise UsageError for an unknown route."""
    from baqueano.cli.driving.teach import shape_or_route

    return None if route is None else shape_or_route(route, 0.25, 1.0)


def _forecast_drive(fit: "Fit", runs: "list[Run]", lap: "Route | None", name: str | None) -> Any:
    """Return the forecast of a drive from the errors of the fit; None if it cannot be computed."""
    from baqueano.validation import forecast

    try:
        with show_activity(note("cli.predicting")):
            return forecast(fit, runs, lap, name or "")
    except UsageError as error:
        if name is not None and fit.verdict != Verdict.REFUSED:
            print_message(error.diagnostic)
        return None


def _extra_rows(fit: "Fit", validation: Any) -> list[TableRow]:
    """Return further rows for --json: the requested parameters of each run, and the figures of held-out runs."""
    from baqueano.identify.result.fit_result import is_requested

    per_run_rows = [row for row in fit.run_by_run() if is_requested(row["name"])]
    if validation is None:
        return per_run_rows
    reasons, outside_rows = (
        list(map(json_row, table)) for table in (validation.reasons, validation.range_notes)
    )
    summary = {
        "verdict": validation.verdict, "sentence": validation.sentence, "reasons": reasons, "outside": outside_rows,
    }  # fmt: skip
    return [
        *per_run_rows,
        *({"name": "held_out", **row} for row in validation.rows()),
        {"name": "held_out_verdict", **summary},
    ]


def _fit_arguments(values: JsonObject, backend: str) -> JsonObject:
    """Return the keyword arguments of `identify`."""
    from baqueano.identify import FitOptions

    options = FitOptions(
        fixed=values["fix"],
        bounds=dict(map(numbers.parse_bounds, values["bound"])),
        per_run=values["per_run"],
        clocks=values["clock"],
        segment_s=values["segment"],
        speed_noise=values["speed_noise"],
        cost=values["cost"],
        measured=values["measured"],
        backend=backend,
    )
    return {"free": values["free"] or None, "use": values["use"] or None, "options": options}


def _with_tolerances(
    vehicle_file: "VehicleFile", tolerances: tuple[str, ...], runs: "list[Run]", arguments: JsonObject
) -> Any:
    """Return the file with the tolerances of its scales. Raise UsageError if the fit would ignore these."""
    from baqueano.calibration.tolerances import with_tolerance
    from baqueano.identify.imu_only import is_imu_only

    if not tolerances:
        return vehicle_file
    conflicts = _plain_fit_options(arguments)
    if conflicts or not is_imu_only(vehicle_file, runs, arguments["use"], arguments["free"]):
        if not conflicts and not is_imu_only(vehicle_file, runs, ("imu",), arguments["free"]):
            raise UsageError.of("cli.tolerance-car", value=tolerances[0])
        code = "cli.tolerance-conflict" if conflicts else "cli.tolerance-unused"
        raise UsageError.of(code, "--use imu", value=tolerances[0], second_option=conflicts[:1])
    fractions = {}
    for tolerance in tolerances:
        key, _, fraction_text = tolerance.partition("=")
        try:
            fractions[key] = float(fraction_text.rstrip("%")) * (0.01 if fraction_text.endswith("%") else 1.0)
        except ValueError as error:
            raise UsageError.of(
                "cli.tolerance", "--tolerance sensors.imu.gyro_scale=0.01", value=tolerance
            ) from error
    return with_tolerance(vehicle_file, fractions)


def _select_terms(
    runs: "list[Run]",
    vehicle_file: "VehicleFile",
    arguments: JsonObject,
    validation_runs: "list[Run]",
    notify: Callable[[str], object],
) -> Any:
    """Return the model with the terms that held-out data, or the `validation_runs` if there are any, support."""
    from baqueano.identify.imu_only import is_imu_only
    from baqueano.selection.choose import choose

    if other_options := _plain_fit_options(arguments):
        raise UsageError.of("cli.choose-conflict", "--choose --update", others=other_options)
    if is_imu_only(vehicle_file, runs, arguments["use"], arguments["free"]):
        raise UsageError.of("cli.choose-without-encoders", "--free +KEY")
    return choose(runs, vehicle_file, progress=notify, held_out=validation_runs, **arguments)


def _plain_fit_options(arguments: JsonObject) -> list[str]:
    """Return the used command line options that only a plain fit accepts."""
    return [OPTIONS[name][0] for name in arguments["options"].non_defaults if name in PLAIN_FIT_ARGUMENTS]


def _validate_fit(
    fit: "Fit",
    runs: "list[Run]",
    validation_runs: "list[Run]",
    start_file: "VehicleFile",
    arguments: JsonObject,
) -> tuple["Fit", Any]:
    """Return the fit with a note on its cost, and its validation on held-out runs."""
    from baqueano.validation.cost_advice import refit_with_cost, with_cost_advice
    from baqueano.validation.held_out import validate

    with show_activity(note("cli.judging", runs=len(validation_runs))):
        validation = validate(fit, validation_runs)
        refit = refit_with_cost(runs, start_file, **arguments)
        return with_cost_advice(fit, validation_runs, validation, refit), validation


def _measured_noise(fit: "Fit", runs: "list[Run]", validation_runs: "list[Run]", backend: str) -> Any:
    """Return Q and R. If the truth is known, held-out runs select R: from the truth, or from the innovations."""
    from baqueano.identify.noise.covariances import measure_noise
    from baqueano.validation.noise_comparison import compare_noise

    with show_activity(note("cli.measuring-noise")):
        noise = measure_noise(fit, runs, held_out=validation_runs, backend=backend)
    if validation_runs and noise.source == "truth":
        with show_activity(note("cli.trying-noise")):
            innovation_noise = measure_noise(fit, runs, source="innovations", backend=backend)
            noise_by_source = {noise.source: noise, innovation_noise.source: innovation_noise}
            try:
                comparison = compare_noise(fit, noise_by_source, validation_runs, backend)
            except UsageError as error:
                print_message(error.diagnostic)
            else:
                print_message(comparison.table())
                noise = noise_by_source[comparison.best]
    print_message(noise.table())
    return noise


def _fit_drift(
    runs: "list[Run]", vehicle_file: "VehicleFile", arguments: JsonObject, report: ReportFiles,
    update: bool, as_json: bool,
) -> None:  # fmt: skip
    from baqueano.validation.parameter_drift import parameter_history

    with show_steps() as begin:
        drift = parameter_history(runs, vehicle_file, progress=begin, **arguments)
    print_answer(drift, as_json)
    _write_table(report, drift, vehicle_file, f"{vehicle_file.name} over {len(runs)} runs")
    replace(report, table=None).write_page(drift)
    options.save_update(drift.vehicle_file, update)


def _write_table(report: ReportFiles, result: Any, vehicle_file: "VehicleFile", caption: str) -> None:
    from baqueano.identify.data.record import FittedBlocks

    report.write_table(result, caption, FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors))
