"""Write the page about one run: its path, its speed, its errors, the consistency of the filter, and the commands."""

import tomllib
from typing import NamedTuple

import numpy as np

from baqueano.compare import compare, evenness
from baqueano.compare.comparison import ADVICE_CODES, DIVERGED, FAILED, NOT_DEFINITE
from baqueano.compare.divergence import cut_at_divergence
from baqueano.diagnostics import Verdict
from baqueano.messages.language import number, translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.monitor import REJECTIONS_SOURCE, Rejections
from baqueano.report import figures
from baqueano.report.estimate_report import (
    comparison_section,
    consistency_sections,
    errors,
    path_sentence,
    paths,
)
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw
from baqueano.runs import Run
from baqueano.runs.show import show
from baqueano.signals import seconds
from baqueano.vehicles.drivetrain import mix

IMU = ("a_x [m/s²]", "a_y [m/s²]", "ω_z [rad/s]")
NOT_CONSISTENT = (*ADVICE_CODES, NOT_DEFINITE, DIVERGED, FAILED)
VERDICTS = {"consistent": Verdict.CONSISTENT} | dict.fromkeys(NOT_CONSISTENT, Verdict.INCONSISTENT)


def run_page(run: Run, alignment: str = "none", second: Run | None = None) -> Page:
    """Return the page of a run: path, errors, innovations, commands, events. `alignment` is as in `compare`.

    The run `second` is of another estimator on the same drive: its estimate is also drawn and assessed.
    """
    comparison = compare([run] if second is None else [run, second], alignment=alignment)
    run_figures = comparison.runs[0]
    row, drove = run_figures.row(), comparison.has_drives and len(run.t_ns) > 0
    run = cut_at_divergence(run)
    drawings = paths(run, alignment, second)
    sections = [Section(_("Path"), path_sentence(run_figures, alignment), drawings)] if drawings else []
    sections += comparison_section(comparison) if second is not None else []
    sections += driving_sections(run, row) if drove else []
    sections += errors(run, alignment, second)
    sections += consistency_sections(run_figures.consistency, run)
    sections += refused_section(run_figures.refusals)
    sections += [Section(_("Measurements"), "", [sensor_drawing(run)])] if run.sensors else []
    sections.append(Section(_("Content of the run"), "", [contents_table(run), *_events_table(run)]))
    kind = run.metadata.get("kind", "run")
    return Page(
        title=run.name,
        subtitle=_(
            "{kind}, {duration_s:.1f} s, {ticks} ticks",
            kind=_(kind),
            duration_s=run.duration_s,
            ticks=len(run.t_ns),
        ),
        verdict=VERDICTS.get(row["verdict"], ""),
        headlines=headlines(row, drove),
        sections=sections,
        reproduce=baqueano_command("report", run.name),
    )


def headlines(row: dict, with_vehicle: bool = True) -> list[Headline]:
    """Return the known values of a comparison as headlines.

    The values of the vehicle are included only `with_vehicle`, if the assessed estimate was used to drive it.
    """
    prefix, source = ("pace_true", _("true"))
    if not np.isfinite(row["pace_true_error"]):
        prefix, source = ("pace_estimate", _("by the estimate"))
    vehicle_rows = (
        ("across_true_rms_m", _("across the path, true value"), _("rms"), 100, "cm"),
        (
            f"{prefix}_error",
            _("error of the speed from its reference"),
            _("rms, relative to the requested mean; {whose}", whose=source),
            100,
            "%",
        ),
        ("saturated_fraction", _("at a limit"), _("of the ticks, command or wheel"), 100, "%"),
        ("sign_changes_per_s", _("changes of sign"), _("of the forward command"), 1, _("per s")),
    )
    estimate_rows = (
        ("ate_m", _("error of the estimated position"), _("rms against truth"), 100, "cm"),
        ("speed_error_m_s", _("error of the estimated speed"), _("rms against truth"), 1000, "mm/s"),
        (
            "nees_velocity",
            _("NEES of the velocity"),
            _("{verdict}; 1 is ideal", verdict=_(row["nees_velocity_verdict"])),
            1,
            "",
        ),
        ("nis", "NIS", _("{verdict}; 1 is ideal", verdict=_(row["nis_verdict"])), 1, ""),
    )
    return [
        Headline(label, f"{number(row[key] * scale):.3g} {unit}".strip(), note)
        for key, label, note, scale, unit in (*(vehicle_rows if with_vehicle else ()), *estimate_rows)
        if row.get(key) is not None and np.isfinite(row[key])
    ]


def contents_table(run: Run) -> Table:
    """Return the table of the topics of a run; without the columns that all topics leave empty."""
    headings = {
        "topic": _("topic"), "count": _("count"), "rate_hz": f"{_('rate')} [Hz]", "gaps": _("gaps"),
        "first_gap_s": _("first gap [s]"), "longest_step_s": f"{_('longest step')} [s]", "nan_rows": "NaN",
        "delay_ms": f"{_('delay')} [ms]", "size": _("size"),
    }  # fmt: skip
    rows = show(run).rows()
    columns = [key for key in headings if any(row.get(key) is not None for row in rows)]
    return Table(
        [{key: row.get(key) for key in columns} for row in rows], "", {key: headings[key] for key in columns}
    )


def refused_section(counts: tuple[Rejections, ...]) -> list[Section]:
    """Return the section with the rejected readings of each channel; [] if the estimator does not count them."""
    rows = [
        {"channel": count.name, "readings": count.reading_count, _("rejected"): count.rejected_count,
         _("rejected [%]"): 100.0 * count.rejected_count / max(count.reading_count, 1)}
        for count in counts
    ]  # fmt: skip
    caption = _("A reading far from its prediction is rejected, or gets a smaller weight.")
    return [Section(_("Rejected readings"), caption, [Table(rows)])] if rows else []


def sensor_drawing(run: Run) -> Drawing:
    """Return the drawing of the readings of the sensors, a panel per channel."""
    panels = []
    for name, channel in run.sensors.items():
        t = seconds(channel.t_ns, run.start_ns)
        for k in range(channel.z.shape[1]):
            label = IMU[k] if name == "imu" and channel.z.shape[1] == 3 else f"{name}[{k}]"
            panels.append((label, {"measured": (t, channel.z[:, k])}))
    return draw(figures.draw_time_series(panels), _("Measurements of the sensors."))


def driving_sections(run: Run, row: dict) -> list[Section]:
    """Return the sections on the forward speed against its reference, and on the commands with their limits."""
    drawing = speed_drawing(run)
    pace_drawings = [] if drawing is None else [Section(_("Speed"), "", [drawing, *_pace_table(row)])]
    return [*pace_drawings, commands_section(run)]


def speed_drawing(run: Run) -> Drawing | None:
    """Return the drawing of the forward speed against its reference; None for a run without speeds."""
    curves = {}
    for name, log in (("truth", run.truth), ("estimate", run.estimate), ("reference", run.guide_reference)):
        if log is not None and np.isfinite(log.nu[:, 0]).any():
            curves[name] = seconds(log.t_ns, run.start_ns), log.nu[:, 0]
    if not curves:
        return None
    return draw(
        figures.draw_time_series([(_("forward speed [m/s]"), curves)], height_in=2.6),
        _("Speed during the run."),
    )


def _pace_table(row: dict) -> list[Table | Drawing]:
    """Return the table of the speed errors against the reference, without start and last braking."""
    rows = [
        {
            "speed": source,
            _("error from its reference, rms [m/s]"): row[f"{name}_error_m_s"],
            _("of the requested mean [%]"): 100.0 * row[f"{name}_error"],
            _("uneven, about its 1 s mean [%]"): 100.0 * row[f"{name}_unevenness"],
        }
        for name, source in (("pace_true", _("true")), ("pace_estimate", _("by the estimate")))
        if np.isfinite(row[f"{name}_error"])
    ]
    if rows:
        return [
            Table(rows, _("Without start and last braking; a steady error does not count as unevenness."))
        ]
    return []


class _CommandCurve(NamedTuple):
    """The curve of a command, or of a wheel after the mixing."""

    name: str
    curves: dict[str, np.ndarray]  # name → (N,)
    signal: np.ndarray  # (N,) the assessed signal
    limit: float  # inf: unlimited, or unknown


def commands_section(run: Run) -> Section:
    """Return the section with each command, and each wheel after the mixing, with its limit."""
    t = seconds(run.t_ns, run.start_ns)
    panels, rows = [], []
    for name, curves, command, limit in _command_curves(run):
        is_at_limit = np.abs(command) >= evenness.LIMIT_SHARE * limit
        curves_shown = {curve_name: (t, u) for curve_name, u in curves.items()}
        curves_shown |= {"limit": (t, np.full(len(t), limit))} if np.isfinite(limit) else {}
        panels.append(
            (
                name,
                curves_shown
                | ({"at its limit": (t[is_at_limit], command[is_at_limit])} if is_at_limit.any() else {}),
            )
        )
        magnitude = np.abs(command[np.isfinite(command)])
        rows.append({
            "command": name, "largest": float(magnitude.max(initial=0.0)),
            "limit": limit if np.isfinite(limit) else None,
            _("at its limit [% of ticks]"): 100.0 * float(np.mean(is_at_limit)) if np.isfinite(limit) else None,
        })  # fmt: skip
    drawing = draw(
        figures.draw_time_series(panels),
        _("The command as requested, as applied, and as sent to each wheel; red: at its limit or beyond."),
    )
    return Section(_("Commands"), "", [drawing, Table(rows)])


def _command_curves(run: Run) -> list[_CommandCurve]:
    """Return the curves of the commands that this vehicle uses, then the curves of its two wheels."""
    limits, names = evenness.read_limits(run.vehicle_text), run.command_names
    unit = _command_unit(run)
    commands_sent = run.applied_commands if run.sent_commands is None else run.sent_commands
    n = commands_sent.shape[1]
    if limits is None or len(limits.command) != n:
        limits = evenness.Limits(np.full(n, np.inf))
    command_curves = []
    for k in range(n):
        if limits.command[k] > 0.0 or run.applied_commands[:, k].any():
            curves = {} if run.requested_commands is None else {"requested": run.requested_commands[:, k]}
            command_curves.append(
                _CommandCurve(
                    names[k] + unit,
                    curves | {"applied": run.applied_commands[:, k]},
                    commands_sent[:, k],
                    limits.command[k],
                )
            )
    if limits.mixing == "two_wheels":
        for name, w, limit in zip(
            (_("left wheel"), _("right wheel")),
            mix(limits.mixing, commands_sent.T),
            limits.channel,
            strict=True,
        ):
            command_curves.append(_CommandCurve(name + unit, {"sent": w}, w, float(limit)))
    return command_curves


def _command_unit(run: Run) -> str:
    """Return the unit of the commands in brackets, from the vehicle file of the run; "" without a unit."""
    try:
        return f" [{tomllib.loads(run.vehicle_text)['command']['unit']}]"
    except (tomllib.TOMLDecodeError, RecursionError, KeyError, TypeError):
        return ""


def _events_table(run: Run) -> list[Table | Drawing]:
    rows = [
        {"t [s]": float(seconds(e.t_ns, run.start_ns)), "level": e.level, "by": e.source, "what": e.sentence}
        for e in run.events
        if e.source != REJECTIONS_SOURCE
    ]
    return [Table(rows, _("Events of the run."))] if rows else []
