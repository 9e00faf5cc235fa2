"""Draw the figures of the reports for `result.plot(kind)`, one by one; the user may style them."""

from collections.abc import Callable, Sequence
from functools import partial, singledispatch
from typing import TYPE_CHECKING

import numpy as np

from baqueano.calibration.at_rest import RestMeasurement
from baqueano.calibration.result import Calibration
from baqueano.compare import Comparison
from baqueano.compare.comparison import RunComparison
from baqueano.compare.corridor_forecast import CorridorForecast
from baqueano.contracts.result import Tabular
from baqueano.diagnostics import nearest
from baqueano.drive import FirstDrive, TeachResult
from baqueano.drive.closure import Closure
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.identify import Fit
from baqueano.identify.noise.covariances import Noise
from baqueano.identify.result.fit_result import ChannelFit
from baqueano.messages.language import number, shown_unit, translate as _
from baqueano.report import figures
from baqueano.report.figures import MEASUREMENT, MODEL, REFERENCE, TRUTH
from baqueano.report.fit_report import draw_most_motion, label
from baqueano.report.libraries import draw_onto, panel, panels, set_log_scale, with_style
from baqueano.report.page import Drawing, Table
from baqueano.report.pages.at_rest import allan_curves, sensor_channels
from baqueano.report.pages.parameter_drift import curve_parameters, curves
from baqueano.report.pages.route import plot_demand, plot_examined_route, plot_route
from baqueano.report.run_report import commands_section, errors, paths, sensor_drawing, speed_drawing
from baqueano.report.style import LEGEND_ABOVE
from baqueano.routes.examine import RouteReport
from baqueano.runs import Run
from baqueano.runs.importing.recordings import ImportedRun
from baqueano.simulate import Ensemble
from baqueano.tune import TuneResult
from baqueano.tune.tune_result import FACTORS
from baqueano.validation.forecast import Forecast
from baqueano.validation.held_out import Validation
from baqueano.validation.parameter_drift import ParameterHistory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from baqueano.report.libraries import Target

Draw = Callable[[], "Figure | None"]  # None: the result has no data for it


def plot(
    result: Tabular, kind: str = "", target: "Target" = None, width: str | float | None = None
) -> "Figure":
    """Draw `kind` of a result, or its first available drawing, onto `target` or a figure of `width`.

    Raise UsageError for an unknown kind, or if the result does not contain the data.
    """
    drawings = make_drawings(result)
    name = type(result).__name__.lower()
    if kind and kind not in drawings:
        raise UsageError.of("front.plot-unknown", value=kind, result=name, suggestion=nearest(kind, drawings))
    with draw_onto(target):
        for draw in [drawings[kind]] if kind else drawings.values():
            figure = draw()
            if figure is not None:
                from baqueano.report.canvas import resize_figure

                return resize_figure(figure, width)
    if kind:
        raise UsageError.of("front.no-data", result=name, value=kind, kinds=[*drawings])
    raise UsageError.of("front.nothing-to-draw", result=name)


@singledispatch
def make_drawings(result: Tabular) -> dict[str, Draw]:
    """Return the drawings of a result by name, the most informative drawing first."""
    return {}


@make_drawings.register(Run)
def _run_drawings(result: Run) -> dict[str, Draw]:
    makers: dict[str, Callable[[], Sequence[Table | Drawing | None]]] = {
        "path": lambda: paths(result),
        "errors": lambda: [part for section in errors(result) for part in section.parts],
        "speed": lambda: [speed_drawing(result)],
        "commands": lambda: commands_section(result).parts,
        "sensors": lambda: [sensor_drawing(result)] if result.sensors else [],
    }
    return {name: partial(_first_figure, draw) for name, draw in makers.items()}


def _first_figure(draw: Callable[[], Sequence[Table | Drawing | None]]) -> "Figure | None":
    return next((part.figure for part in draw() if isinstance(part, Drawing)), None)


@make_drawings.register(Fit)
def _fit_drawings(result: Fit) -> dict[str, Draw]:
    identifiable = np.isfinite(result.std) & np.isfinite(result.estimate)
    names = [
        name.removeprefix("model.")
        for name, is_kept in zip(result.names, identifiable, strict=True)
        if is_kept
    ]
    channels = [
        channel
        for channel in result.channels
        if channel.run == result.runs[0] and np.isfinite(channel.explained_fraction)
    ]
    if not channels:
        return {}
    return {
        "estimates": lambda: figures.estimates(
            names, result.estimate[identifiable], result.std[identifiable]
        ),
        **_channel_drawings(channels),
        "correlation": lambda: figures.correlation(
            names, result.correlation[np.ix_(identifiable, identifiable)]
        ),
    }


def _channel_drawings(channels: Sequence[ChannelFit]) -> dict[str, Draw]:
    """Return the drawings of the channels of one run: data beside the model, and residuals."""
    return {
        "data": lambda: draw_most_motion(list(channels))[0],
        "residuals": lambda: figures.residuals(
            np.stack([channel.residuals / channel.sigma for channel in channels], axis=1),
            [label(reason) for reason in channels],
        ),
    }


@make_drawings.register(Validation)
def _validation_drawings(result: Validation) -> dict[str, Draw]:
    finite_channels = [channel for channel in result.channels if np.isfinite(channel.explained_fraction)]
    return (
        _channel_drawings([channel for channel in finite_channels if channel.run == finite_channels[0].run])
        if finite_channels
        else {}
    )


@make_drawings.register(TeachResult)
@make_drawings.register(ImportedRun)
@make_drawings.register(FirstDrive)
def _replay_drawings(result: TeachResult | ImportedRun | FirstDrive) -> dict[str, Draw]:
    return _run_drawings(result.run)


@make_drawings.register(RestMeasurement)
def _rest_drawings(result: RestMeasurement) -> dict[str, Draw]:
    return {sensor: partial(allan_curves, channels) for sensor, channels in sensor_channels(result).items()}


@make_drawings.register(Calibration)
def _calibration_drawings(result: Calibration) -> dict[str, Draw]:
    finite_channels = [
        value for value in result.numbers if np.isfinite(value.half_width) and value.value != 0.0
    ]
    values, half_width = (
        np.array([getattr(value, name) for value in finite_channels]) for name in ("value", "half_width")
    )
    names = [value.name for value in finite_channels]
    return (
        {"estimates": lambda: figures.estimates(names, values, half_width / 1.96)} if finite_channels else {}
    )


@make_drawings.register(Closure)
def _closure_drawings(result: Closure) -> dict[str, Draw]:
    names, scale, std = [f"{result.gyro}.gyro_scale"], np.array([result.scale]), np.array([result.std])
    return {"estimates": lambda: figures.estimates(names, scale, std)}


@make_drawings.register(ParameterHistory)
def _history_drawings(result: ParameterHistory) -> dict[str, Draw]:
    entries = curve_parameters(result)
    return {"parameters": lambda: curves(result, entries)} if entries else {}


@make_drawings.register(CorridorForecast)
def _corridor_drawings(result: CorridorForecast) -> dict[str, Draw]:
    return {
        "path": partial(_first_figure, lambda: paths(result.run)),
        "corridor": lambda: plot_corridor(result),
    }


@with_style
def plot_comparison(result: Comparison) -> "Figure | None":
    """Draw the errors of each run, and the consistency of its estimator: 1 is ideal, the bar is the expected range.

    Return None without any of these figures.
    """
    runs = result.runs
    if not np.isfinite([_run_errors(run) for run in runs]).any():
        return None
    figure, axes = panels(2, 1, (7.2, 0.7 * len(runs) + 2.6))
    upper, lower = axes[:, 0]
    rows = np.arange(len(runs))[::-1]
    series = (
        (_("across its path"), [run.across_true.rms_m for run in runs], TRUTH, "s"),
        (_("by the estimate"), [run.across_estimate.rms_m for run in runs], MODEL, "o"),
        (_("position error"), [run.ate_m for run in runs], MEASUREMENT, "D"),
    )
    for name, metres, colour, marker in series:
        if np.isfinite(metres).any():
            upper.plot(100.0 * np.array(metres), rows, marker, ms=5, color=colour, label=name)
    upper.set_xlim(left=0.0)
    upper.set_xlabel(_("error [cm rms]"))
    for k, (name, values, colour) in enumerate(
        (("nees_velocity", _("NEES of the velocity"), MODEL), ("nis", "NIS", MEASUREMENT))
    ):
        heights, bands = rows + 0.15 - 0.3 * k, [getattr(run.consistency, name) for run in runs]
        lower.hlines(
            heights, [b.low for b in bands], [b.high for b in bands], color=REFERENCE, lw=5, zorder=1
        )
        lower.plot([b.mean for b in bands], heights, "o", ms=5, color=colour, label=values)
    lower.axvline(1.0, color=TRUTH, lw=1)
    set_log_scale(lower.xaxis)
    lower.set_xlabel(_("error² / claimed variance"))
    for ax in (upper, lower):
        ax.set_yticks(rows, [run.name for run in runs])
        ax.set_ylim(-0.6, len(runs) - 0.4)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(**(LEGEND_ABOVE | {"ncols": 2}))
    return figure


def _run_errors(run: RunComparison) -> list[float]:
    """Return the figures of a run that `plot_comparison` draws."""
    means = [run.consistency.nees_velocity.mean, run.consistency.nis.mean]
    return [run.across_true.rms_m, run.across_estimate.rms_m, run.ate_m, *means]


@with_style
def plot_search(result: TuneResult) -> "Figure":
    """Draw the lowest cost so far along each descent of the tuning."""
    figure, axes = panel((7.2, 3.6))
    for k, descent in enumerate(result.descents):
        costs = np.minimum.accumulate(descent.costs)
        style = {"color": MODEL, "lw": 2.0, "zorder": 3} if k == 0 else {"color": REFERENCE, "lw": 1.0}
        axes.plot(np.arange(1, len(costs) + 1), costs, label=_("best start") if k == 0 else "", **style)
    if np.isfinite(result.cost_before):
        axes.axhline(result.cost_before, color=MEASUREMENT, lw=1, ls="--", label=_("gains of the file"))
    set_log_scale(axes.yaxis)
    axes.set_xlabel(_("evaluations"))
    axes.set_ylabel(_("cost [m²]"))
    axes.legend()
    return figure


@with_style
def plot_cost_around(result: TuneResult) -> "Figure":
    """Draw the cost around the optimum, with one gain at a time decreased and increased."""
    figure, axes = panel((7.2, 3.6))
    rows = [np.where(np.isfinite(row), row, np.nan) for row in result.relative_costs]
    for gain, row in zip(result.gains, rows, strict=True):
        axes.plot(FACTORS, 100.0 * (row - 1.0), "o-", ms=3, lw=1.5, label=gain.name)
    axes.axvline(1.0, color=REFERENCE, lw=1)
    axes.set_xscale("log")
    axes.set_xticks(FACTORS, [f"{number(factor):g}" for factor in FACTORS], minor=False)
    axes.minorticks_off()
    axes.set_xlabel(_("gain divided by the tuned gain"))
    axes.set_ylabel(_("more cost [%]"))
    axes.legend()
    return figure


@with_style
def plot_corridor(result: CorridorForecast) -> "Figure":
    """Draw the half-width of the 95 % corridor across the path over time."""
    figure, axes = panel((7.2, 3.0))
    corridor_ = result.corridor
    axes.fill_between(corridor_.t_s, 0.0, 100.0 * corridor_.across_m, color=MODEL, alpha=0.25, lw=0)
    for lap in range(1, result.laps):
        axes.axvline(lap * result.lap_s, color=REFERENCE, lw=1)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(_("time [s]"))
    axes.set_ylabel(_("across, 95 % [± cm]"))
    return figure


@with_style
def plot_noise(result: Noise) -> "Figure":
    """Draw the standard deviation of each channel and state, in motion and at rest."""
    rows = [row for row in result.rows() if row["unit"] != "s"]  # a fade time is not a deviation
    figure, axes = panel((7.2, 0.32 * len(rows) + 1.4))
    heights = np.arange(len(rows))[::-1]
    for key, name, colour, marker in (
        ("std", _("in motion"), MODEL, "o"), ("std_at_rest", _("at rest"), MEASUREMENT, "D")
    ):  # fmt: skip
        values = np.array([np.nan if row[key] is None else row[key] for row in rows], dtype=float)
        if np.isfinite(values).any():
            axes.plot(values, heights, marker, ms=5, color=colour, label=name)
    units = [shown_unit(row["unit"]) for row in rows]
    axes.set_yticks(heights, [f"{row['name']} [{unit}]" for row, unit in zip(rows, units, strict=True)])
    set_log_scale(axes.xaxis)
    axes.set_xlabel(_("standard deviation"))
    axes.legend(**LEGEND_ABOVE)
    return figure


@with_style
def plot_forecast(result: Forecast) -> "Figure":
    """Draw the standard deviation of the final position of each drive."""
    figure, axes = panel((7.2, 0.5 * len(result.drives) + 0.9))
    rows = np.arange(len(result.drives))[::-1]
    axes.barh(
        rows, [100.0 * forecast.position_m for forecast in result.drives], height=0.5, color=MODEL, alpha=0.6
    )
    axes.set_yticks(
        rows,
        [
            f"{number(forecast.duration_s):.0f} s, {number(forecast.distance_m):.1f} m"
            for forecast in result.drives
        ],
    )
    axes.set_xlabel(_("position at the end, open loop [± cm]"))
    return figure


@with_style
def plot_ensemble(result: Ensemble) -> "Figure":
    """Draw the end position of each vehicle, and the path of each; of many vehicles only about MAX_PATHS paths."""
    figure, axes = panel((7.2, 6.2))
    sample = result.eta[:: max(1, len(result.eta) // MAX_PATHS)]
    axes.plot(sample[:, :, 0].T, sample[:, :, 1].T, color=MODEL, lw=0.8, alpha=0.25)
    axes.plot(result.eta[:, -1, 0], result.eta[:, -1, 1], ".", ms=2, color=TRUTH, label=_("at the end"))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend()
    return figure


MAX_PATHS = 200  # paths that are drawn

PLOTS: dict[type, dict[str, Callable[..., "Figure | None"]]] = {  # of results that their plots draw alone
    Route: {"path": plot_route},
    RouteReport: {"demand": plot_demand, "path": plot_examined_route},
    Noise: {"deviations": plot_noise},
    Comparison: {"runs": plot_comparison},
    TuneResult: {"search": plot_search, "cost": plot_cost_around},
    Forecast: {"drives": plot_forecast},
    Ensemble: {"path": plot_ensemble},
}
for _kind, _plots in PLOTS.items():
    make_drawings.register(
        _kind, lambda result, plots=_plots: {name: partial(plot, result) for name, plot in plots.items()}
    )
