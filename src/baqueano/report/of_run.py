"""The page about one run: where it went, how evenly, how far off it was, whether the filter knew, what was sent."""

import tomllib
from typing import NamedTuple

import numpy as np

from baqueano.command_line import typed
from baqueano.compare import compare, evenness
from baqueano.compare.corridor import corridor_of
from baqueano.compare.errors import aligned
from baqueano.compare.filter_consistency import FilterConsistency
from baqueano.diagnostics import Verdict
from baqueano.geometry import map_from_body
from baqueano.monitor import REFUSED, Refusals
from baqueano.report import figures
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw
from baqueano.runs import Run
from baqueano.runs.interpolated import at_times, poses_at
from baqueano.runs.show import show
from baqueano.signals import seconds
from baqueano.vehicles.drivetrain import mix

PLACES = 400  # of the corridor, along a path
IMU = ("a_x [m/s²]", "a_y [m/s²]", "ω_z [rad/s]")
VERDICTS = {
    "consistent": "OK",
    "too cautious": Verdict.WARN,
    "too sure": Verdict.WARN,
    "cannot tell": "",
    "not reported": "",
}


def page_of_run(run: Run, alignment: str = "none") -> Page:
    """Return the sections of a run: path, errors, innovations, commands, events.  alignment as in compare."""
    one = compare(run, alignment=alignment).runs[0]
    judged = one.row()
    drawn = paths(run, alignment)
    sections = [Section("Path", _said_of_path(run, alignment), drawn)] if drawn else []
    sections += driving(run, judged)
    sections += errors(run, alignment)
    sections += knows(one.consistency)
    sections += refused(one.refusals)
    sections += [Section("Measurements", "", [_sensors(run)])] if run.sensors else []
    held = show(run)
    sections.append(Section("What the run holds", "", [Table(held.rows()), *_events(run)]))
    kind = run.metadata.get("kind", "run")
    return Page(
        title=run.name,
        subtitle=f"{kind}, {run.duration_s:.1f} s, {len(run.t_ns)} ticks",
        verdict=VERDICTS.get(judged["verdict"], ""),
        headlines=headlines(judged),
        sections=sections,
        reproduce=typed("report", run.name),
    )


def headlines(judged: dict) -> list[Headline]:
    """The figures of a comparison that are known, large."""
    by, whose = ("pace_true", "true")
    if not np.isfinite(judged["pace_true_error"]):
        by, whose = ("pace_estimate", "as it believed")
    wanted = (
        ("across_true_rms_m", "across the path, true", "rms", 100, "cm"),
        (f"{by}_error", "speed off its reference", f"rms, of the mean asked; {whose}", 100, "%"),
        ("at_limit", "at a limit", "of the ticks, command or wheel", 100, "%"),
        ("sign_changes_per_s", "changes of sign", "of the forward command", 1, "per s"),
        ("ate_m", "estimated position off", "rms against truth", 100, "cm"),
        ("speed_error_m_s", "estimated speed off", "rms against truth", 1000, "mm/s"),
        ("nees_velocity", "NEES of the velocity", f"{judged['nees_velocity_is']}; 1 is ideal", 1, ""),
        ("nis", "NIS", f"{judged['nis_is']}; 1 is ideal", 1, ""),
    )
    return [
        Headline(label, f"{judged[key] * scale:.3g} {unit}".strip(), note)
        for key, label, note, scale, unit in wanted
        if judged.get(key) is not None and np.isfinite(judged[key])
    ]


def _said_of_path(run: Run, alignment: str) -> str:
    found = corridor_of(run)
    said = ""
    if found is not None:
        said = "Shaded: where the vehicle may be, to the left and right of where it believes to be. "
        said += f"{found.sentence[:1].upper()}{found.sentence[1:]}."
    laid = {"none": "", "start": " The estimate is laid on the truth at its start.",
            "rigid": " The estimate is laid on the truth by the best rigid motion."}[alignment]  # fmt: skip
    return said + laid


def paths(run: Run, alignment: str = "none") -> list[Table | Drawing]:
    """The drawing of where a run went: reference, truth, estimate with its corridor, whichever it holds."""
    lines: dict[str, np.ndarray] = {}
    band, end = None, None
    if run.asked is not None and len(run.asked.t_ns) > 1:
        lines["reference"] = run.asked.eta[:, :2]
    if run.truth is not None:
        lines["truth"] = run.truth.eta[np.isfinite(run.truth.eta).all(axis=1), :2]
    if run.estimate is not None:
        eta, found = run.estimate.eta, corridor_of(run)
        if run.truth is not None:
            eta = aligned(eta, poses_at(run.estimate.t_ns, run.truth.t_ns, run.truth.eta), alignment)
        lines["estimate"] = eta[:, :2]
        if found is not None and len(found.t_s) > 1:
            last = len(found.t_s) - 1
            places = np.linspace(0, last, min(PLACES, last + 1)).astype(int)
            left = np.stack([-np.sin(eta[places, 2]), np.cos(eta[places, 2])], axis=1)
            half = found.across_m[places, None] * left
            band = np.stack([eta[places, :2] + half, eta[places, :2] - half], axis=1)
            turn = map_from_body(eta[last, 2] - found.eta[last, 2])[:2, :2]
            end = figures.ellipse(eta[last, :2], turn @ run.estimate.cov[last, :2, :2] @ turn.T)
    if not lines:
        return []
    caption = f"The path of {run.name}" + (
        "." if band is None else ", and where it may be with 95 % probability."
    )
    return [draw(figures.paths(lines, band, end), caption)]


def errors(run: Run, alignment: str = "none") -> list[Section]:
    """Errors against the truth with the filter's own ±2σ, where there is truth."""
    log, truth = run.estimate, run.truth
    if log is None or truth is None or len(truth.t_ns) < 2:
        return []
    t = seconds(log.t_ns, run.t_ns[0])
    eta_true = poses_at(log.t_ns, truth.t_ns, truth.eta)
    nu_true = at_times(log.t_ns, truth.t_ns, truth.nu)
    eta = aligned(log.eta, eta_true, alignment)
    band = 2.0 * np.sqrt(np.einsum("kii->ki", log.cov))
    turn = np.degrees(np.angle(np.exp(1j * (eta[:, 2] - eta_true[:, 2]))))
    panels = [
        ("x error [m]", {"±2σ": (t, band[:, 0]), "estimate": (t, eta[:, 0] - eta_true[:, 0])}),
        ("y error [m]", {"±2σ": (t, band[:, 1]), "estimate": (t, eta[:, 1] - eta_true[:, 1])}),
        ("heading error [°]", {"±2σ": (t, np.degrees(band[:, 2])), "estimate": (t, turn)}),
    ]
    if np.isfinite(nu_true[:, 0]).any():
        speed = {"±2σ": (t, band[:, 3]), "estimate": (t, log.nu[:, 0] - nu_true[:, 0])}
        panels.append(("ν_x error [m/s]", speed))
    drawing = draw(figures.over_time(panels), "Estimate minus truth; the band is what the filter promises.")
    return [Section("Errors against the truth", "", [drawing])]


def knows(found: FilterConsistency) -> list[Section]:
    """Return the sentence on the filter's own covariance, and its figures, where there are any."""
    rows = found.figures()
    caption = "1 if consistent; a right covariance lies from … to …, in 95 % of runs."
    return (
        [Section("Does the filter know its errors?", found.sentence, [Table(rows, caption)])] if rows else []
    )


def refused(counts: tuple[Refusals, ...]) -> list[Section]:
    """Return how often the estimator refused each number; nothing of one that does not count."""
    rows = [
        {"number": one.name, "refused": one.refused, "arrived": one.arrived,
         "refused [%]": 100.0 * one.refused / max(one.arrived, 1)}
        for one in counts
    ]  # fmt: skip
    said = "A number that is too far from its prediction loses its weight. Sensors that were off for long are below."
    return [Section("Refused readings", said, [Table(rows)])] if rows else []


def _sensors(run: Run) -> Drawing:
    panels = []
    for name, channel in run.sensors.items():
        t = seconds(channel.t_ns, run.t_ns[0])
        for k in range(channel.z.shape[1]):
            label = IMU[k] if name == "imu" and channel.z.shape[1] == 3 else f"{name}[{k}]"
            panels.append((label, {"measured": (t, channel.z[:, k])}))
    return draw(figures.over_time(panels), "What the sensors said.")


def driving(run: Run, judged: dict) -> list[Section]:
    """The forward speed against its reference, and the commands with their limits."""
    curves = {}
    for name, log in (("truth", run.truth), ("estimate", run.estimate), ("reference", run.asked)):
        if log is not None and np.isfinite(log.nu[:, 0]).any():
            curves[name] = seconds(log.t_ns, run.t_ns[0]), log.nu[:, 0]
    sections = []
    if curves:
        drawing = draw(
            figures.over_time([("forward speed [m/s]", curves)], height_in=2.6), "How fast it drove."
        )
        sections.append(Section("Speed", "", [drawing, *_paces(judged)]))
    return [*sections, _commands(run)]


def _paces(judged: dict) -> list[Table | Drawing]:
    """Draw the error of the speed against its reference, after the first second."""
    rows = [
        {
            "speed": whose,
            "off its reference, rms [m/s]": judged[f"{name}_error_m_s"],
            "of the mean asked [%]": 100.0 * judged[f"{name}_error"],
            "uneven, about its 1 s mean [%]": 100.0 * judged[f"{name}_uneven"],
        }
        for name, whose in (("pace_true", "true"), ("pace_estimate", "as it believed"))
        if np.isfinite(judged[f"{name}_error"])
    ]
    return (
        [Table(rows, "After the first second; a steady error does not count as unevenness.")] if rows else []
    )


class _Channel(NamedTuple):
    """A command, or a wheel behind the mix."""

    name: str
    curves: dict[str, np.ndarray]  # name → (N,)
    sent: np.ndarray  # (N,) what is judged
    limit: float  # inf: none, or not known


def _commands(run: Run) -> Section:
    """Draw each command, and each wheel behind the mix, with its limit."""
    t = seconds(run.t_ns, run.t_ns[0])
    panels, rows = [], []
    for name, curves, sent, limit in _channels(run):
        full = np.abs(sent) >= evenness.AT_LIMIT * limit
        shown = {which: (t, u) for which, u in curves.items()}
        shown |= {"limit": (t, np.full(len(t), limit))} if np.isfinite(limit) else {}
        panels.append((name, shown | ({"at its limit": (t[full], sent[full])} if full.any() else {})))
        size = np.abs(sent[np.isfinite(sent)])
        rows.append({
            "command": name, "largest": float(size.max(initial=0.0)), "limit": limit if np.isfinite(limit) else None,
            "at its limit [% of ticks]": 100.0 * float(np.mean(full)) if np.isfinite(limit) else None,
        })  # fmt: skip
    drawing = draw(
        figures.over_time(panels), "Asked for, applied, and sent to each wheel; red: at its limit or beyond."
    )
    return Section("Commands", "", [drawing, Table(rows)])


def _channels(run: Run) -> list[_Channel]:
    """The commands that this vehicle has a use for, then its two wheels."""
    limits, (names, unit) = evenness.limits_of(run.vehicle_text), _command_names(run)
    sent = run.applied if run.sent is None else run.sent
    n = sent.shape[1]
    if limits is None or len(limits.command) != n:
        limits, names = evenness.Limits(np.full(n, np.inf)), [f"u[{k}]" for k in range(n)]
    found = []
    for k in range(n):
        if limits.command[k] > 0.0 or run.applied[:, k].any():
            curves = {} if run.requested is None else {"asked for": run.requested[:, k]}
            found.append(
                _Channel(
                    names[k] + unit, curves | {"applied": run.applied[:, k]}, sent[:, k], limits.command[k]
                )
            )
    if limits.mixing == "two_wheels":
        for name, w, limit in zip(
            ("left wheel", "right wheel"), mix(limits.mixing, sent.T), limits.channel, strict=True
        ):
            found.append(_Channel(name + unit, {"sent": w}, w, float(limit)))
    return found


def _command_names(run: Run) -> tuple[list[str], str]:
    """Return the names of the commands by the vehicle file of the run, and their unit in brackets."""
    try:
        command = tomllib.loads(run.vehicle_text)["command"]
        return [str(name) for name in command["names"]], f" [{command['unit']}]" if "unit" in command else ""
    except (tomllib.TOMLDecodeError, RecursionError, KeyError, TypeError):
        return [], ""


def _events(run: Run) -> list[Table | Drawing]:
    rows = [
        {"t [s]": float(seconds(e.t_ns, run.t_ns[0])), "level": e.level, "by": e.source, "what": e.text}
        for e in run.events
        if e.source != REFUSED
    ]
    return [Table(rows, "What was noticed.")] if rows else []
