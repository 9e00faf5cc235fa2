"""Write the sections about a fit: the estimates, the agreement of the model with the data, the residuals."""

from typing import TYPE_CHECKING, Any

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict, most_severe_first
from baqueano.identify.result.fit_result import Fit, round_to_error, row_remarks
from baqueano.messages import list_item, texts, with_full_stop
from baqueano.messages.language import mark as N_, number, percent_text, shown_unit, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.report import figures
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw

if TYPE_CHECKING:
    from baqueano.validation.held_out import Validation

CHANNEL_LABELS = {
    "imu": ("a_x [m/s²]", "a_y [m/s²]", "ω_z [rad/s]"),
    "odometer": (N_("odometer [m/s]"),),
    "truth": (N_("true v_x [m/s]"), N_("true v_y [m/s]"), N_("true ω_z [rad/s]")),
}
MAX_DRAWN_RUNS = 6  # runs of a fit to many
MAX_HEADLINES = 4  # channels: more do not fit into one row
MAX_SPAN_S = 20.0  # length of the data, in the figure: the span with most motion


def fit_page(
    fit: Fit,
    truth: np.ndarray | None = None,
    held_out: "Validation | None" = None,
    drive_forecast: Any = None,
) -> Page:
    """Return the page about a fit, with its raw data. A refused fit also has a page.

    `truth` (p,) is drawn beside the estimates.
    `held_out` is the validation on other runs, `drive_forecast` the forecast of drives.
    """
    return Page(
        title=_("Fit of {name}", name=fit.file.name),
        subtitle=_(
            "{runs}; {evaluations} evaluations, back end {backend}",
            runs=_run_names(fit.runs),
            evaluations=fit.evaluations,
            backend=fit.backend,
        ),
        verdict=fit.verdict,
        headlines=[
            Headline(
                _("noise of {channel}", channel=label(c)) + (f", {c.run}" if len(fit.runs) > 1 else ""),
                f"{number(c.sigma):.3g}",
                _("the model explains {part}", part=percent_text(c.explained_fraction)),
            )
            for c in _headline_channels(_worst_channels(fit.channels))
        ],
        sections=[
            _next_step(fit, held_out),
            *(
                [Section(_("Consequences for a drive"), "\n".join(texts(drive_forecast.sentences)), [])]
                if drive_forecast
                else []
            ),
            *fit_sections(fit, truth, reasons=False),
            *_held_out_section(held_out),
        ],
        reproduce=baqueano_command("identify", *(fit.runs if len(fit.runs) <= MAX_DRAWN_RUNS else ["RUNS"])),
    )


def fit_sections(fit: Fit, truth: np.ndarray | None = None, reasons: bool = True) -> list[Section]:
    """Return the sections on parameters, data and model, residuals, and correlation.

    `truth` (p,) is drawn beside the estimates. With `reasons`, the reasons of the verdict are also listed.
    """
    messages = (*(fit.reasons if reasons else ()), *fit.unobservable, *fit.always_unobservable, *fit.notes)
    items = [list_item(message) for message in texts(most_severe_first(messages))]
    rows = [parameter_row(row) for row in fit.rows()]
    if truth is not None:
        rows = [{**row, "truth": float(t)} for row, t in zip(rows, truth, strict=True)]
    identifiable = np.isfinite(fit.std) & np.isfinite(fit.estimate)
    names = [n.removeprefix("model.") for n, k in zip(fit.names, identifiable, strict=True) if k]
    parts: list[Table | Drawing] = [Table(rows)]
    if identifiable.any():
        true_values = None if truth is None else truth[identifiable]
        drawing = figures.estimates(names, fit.estimate[identifiable], fit.std[identifiable], true_values)
        parts.append(
            draw(
                drawing,
                _(
                    "Half-width of the 95 % interval of each estimate; above 100 % of the estimate, it includes 0."
                )
                if truth is None
                else _(
                    "The error of each estimate, with its 95 % interval; an interval that includes 0 is correct."
                ),
            )
        )
    sections = [Section(_("Parameters"), "", parts, items), *_runs_section(fit)]
    sections += [_run_section(fit, run) for run in _drawn_runs(fit.channels)]
    if identifiable.sum() > 1:
        matrix = fit.correlation[np.ix_(identifiable, identifiable)]
        messages = _(
            "A cell off the diagonal that is red, or blue with a minus sign: only the "
            "combination of its two parameters is known."
        )
        drawing = draw(figures.correlation(names, matrix), messages)
        sections.append(Section(_("Correlation of the estimates"), "", [drawing]))
    return sections


def parameter_row(row: TableRow) -> JsonObject:
    """Return a parameter as a table row with its notes; the digits below its error are omitted."""
    std = row["std"]
    value = None if row["estimate"] is None else round_to_error(row["estimate"], std)
    return {
        "parameter": row["name"].removeprefix("model."),
        "estimate": value,
        "std. error": None if std is None else float(f"{std:.2g}"),
        "unit": shown_unit(row["unit"]),
        "start": row["start"],
        "note": row_remarks(row),
    }


def _next_step(fit: Fit, held_out: "Validation | None") -> Section:
    """Return a section with the meaning of the verdict for the reader, and the next step."""
    reasons = [list_item(reason) for reason in texts(most_severe_first(fit.reasons))]
    sentences, items = ([], reasons) if len(reasons) > 1 else (reasons, [])
    if held_out is not None:
        sentences += [
            _("On held-out runs: {sentence}", sentence=with_full_stop(held_out.sentence)),
            *(f"{message}." for message in texts(held_out.range_notes)),
        ]
    advice = [message.figures["advice"] for message in fit.unobservable if "advice" in message.figures]
    if fit.verdict == Verdict.REFUSED:
        sentences.append(_("Next: check the data below. The vehicle file stays as it is."))
    elif advice:
        sentences.append(_("Next: drive again. {advice}.", advice=". ".join(dict.fromkeys(texts(advice)))))
    elif held_out is not None and held_out.verdict == Verdict.REFUSED:
        sentences.append(_("Next: check the held-out runs below. The vehicle file stays as it is."))
    elif held_out is None:
        sentences.append(_("Next: test it with a run that the fit does not use: add --held-out RUN."))
    else:
        sentences.append(_("Next: baqueano tune, then teach and repeat."))
    return Section(_("Verdict and next step"), "\n".join(sentences), [], items)


def _held_out_section(held_out: "Validation | None") -> list[Section]:
    """Return the section with the table and the drawings of runs not used in the fit; [] without such runs."""
    if held_out is None:
        return []
    caption = _("Sensors and model of a held-out run; the model uses only its commands.")
    drawings = []
    for run in _drawn_runs(held_out.channels):
        drawing, channels_shown = draw_most_motion(_run_channels(held_out.channels, run))
        drawings.append(draw(drawing, f"{run}, {channels_shown}. {caption}"))
    return [Section(_("Held-out runs"), held_out.sentence, [Table(held_out.rows()), *drawings])]


def _run_channels(channels: Any, run: str) -> list[Any]:
    """Return the channels of one run whose explained part is finite."""
    return [c for c in channels if c.run == run and np.isfinite(c.explained_fraction)]


def _lowest_explained(channels: Any) -> dict[str, float]:
    """Return, for each run, the explained part of its worst channel, in the order of the runs."""
    lowest: dict[str, float] = {}
    for c in channels:
        if np.isfinite(c.explained_fraction):
            lowest[c.run] = min(lowest.get(c.run, np.inf), c.explained_fraction)
    return lowest


def _worst_channels(channels: object) -> list[Any]:
    """Return the channels of the run that the model explains worst; [] without runs."""
    lowest = _lowest_explained(channels)
    return _run_channels(channels, min(lowest, key=lambda run: lowest[run])) if lowest else []


def _headline_channels(channels: list[Any]) -> list[Any]:
    """Return the MAX_HEADLINES channels that the model explains worst, in their order."""
    worst_indices = np.argsort([c.explained_fraction for c in channels], kind="stable")[:MAX_HEADLINES]
    return [channels[k] for k in sorted(worst_indices)]


def _drawn_runs(channels: object) -> list[str]:
    """Return the runs to draw in their order: at most MAX_DRAWN_RUNS runs, those that the model explains worst."""
    lowest = _lowest_explained(channels)
    worst_runs = sorted(lowest, key=lambda run: lowest[run])[:MAX_DRAWN_RUNS]
    return [run for run in lowest if run in worst_runs]


def _runs_section(fit: Fit) -> list[Section]:
    """Return the section with a row for each run; [] for a single run.

    The caption names the run that the model explains worst.
    """
    worst_runs = _worst_channels(fit.channels)
    if len(fit.runs) < 2 or not worst_runs:
        return []
    caption = _("The model explains {run} least of all runs.", run=worst_runs[0].run)
    run_names = _drawn_runs(fit.channels)
    if len(run_names) < len(fit.runs):
        caption += "\n" + _(
            "Of {runs} runs, the plot shows the {drawn} that the model explains least.",
            drawn=len(run_names),
            runs=len(fit.runs),
        )
    names, rows = dict.fromkeys(label(c) for c in fit.channels if np.isfinite(c.explained_fraction)), []
    for run in fit.runs:
        rows_ = {
            label(c): f"{number(c.sigma):.3g}, {percent_text(c.explained_fraction)}"
            for c in _run_channels(fit.channels, run)
        }
        rows.append({"run": run} | {name: rows_.get(name) for name in names})
    headings = {name: name for name in ("run", *names)}
    return [
        Section(_("Runs"), caption, [Table(rows, _("Noise, and how much the model explains."), headings)])
    ]


def _run_names(runs: Any) -> str:
    """Return the names of the runs of a fit, abbreviated if there are many."""
    if len(runs) <= MAX_DRAWN_RUNS:
        return ", ".join(runs)
    return _("{count} runs, {first} to {last}", count=len(runs), first=runs[0], last=runs[-1])


def _run_section(fit: Fit, run: str) -> Section:
    channels = _run_channels(fit.channels, run)
    data_drawing, channels_shown = draw_most_motion(channels)
    residual = np.stack([c.residuals / c.sigma for c in channels], axis=1)
    over_time = figures.draw_time_series([
        (label(c), {"±2σ": (c.t_s, np.full(len(c.t_s), 2.0)), "residual": (c.t_s, r)})
        for c, r in zip(channels, residual.T, strict=True)
    ], height_in=1.4)  # fmt: skip
    parts: list[Table | Drawing] = [
        draw(
            data_drawing,
            _("Sensors and model, {shown}. The model uses only the commands.", shown=channels_shown),
        ),
        draw(
            over_time,
            _("Residuals over time, in standard deviations: if they are white, 95 % are in the band."),
        ),
        draw(
            figures.residuals(residual, [label(c) for c in channels]),
            _(
                "Distribution of the residuals with the normal density, and their autocorrelation by lag "
                "with the band of white noise."
            ),
        ),
    ]
    return Section(_("Data and model: {run}", run=run), "", parts)


def draw_most_motion(channels: list[Any]) -> tuple[Any, str]:
    """Return a drawing of data and model for the MAX_SPAN_S seconds with most motion, and the text of this span.

    The text is "20 s from 14 s, with most motion", or "all 20 s" for a short run.
    """
    t_s = channels[0].t_s
    measured_values, predicted_values = (
        np.stack([getattr(c, k) for c in channels], axis=1) for k in ("measurements", "predictions")
    )
    rows = figures.most_motion(t_s, measured_values, MAX_SPAN_S)
    t = t_s[rows]
    drawing = figures.channels(t, measured_values[rows], predicted_values[rows], [label(c) for c in channels])
    if len(t) == len(t_s):
        return drawing, _("all {span_s:.0f} s", span_s=t[-1] - t[0])
    return drawing, _(
        "{span_s:.0f} s from {from_s:.0f} s, with most motion", span_s=t[-1] - t[0], from_s=t[0]
    )


def label(channel: Any) -> str:
    """Return the label of a channel, "a_x [m/s²]" for the first channel of an IMU."""
    entries = CHANNEL_LABELS.get(channel.sensor, ())
    return _(entries[channel.entry]) if channel.entry < len(entries) else channel.label
