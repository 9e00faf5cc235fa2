"""The page about one run: where it went, how far off it was, whether the filter knew, what was sent."""

import tomllib

import numpy as np

from baqueano.compare import compare
from baqueano.compare.errors import aligned, at_times, poses_at
from baqueano.report import figures
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw
from baqueano.runs import Run
from baqueano.runs.show import show
from baqueano.signals import seconds

ELLIPSES = 24  # along a path
IMU = ("a_x [m/s²]", "a_y [m/s²]", "ω_z [rad/s]")
VERDICTS = {"consistent": "OK", "too cautious": "WARN", "too sure": "WARN", "not reported": ""}


def page_of_run(run: Run, alignment: str = "none") -> Page:
    """All that a run can show: path, errors, innovations, commands, what was noticed.  alignment as in compare."""
    judged = compare(run, alignment=alignment).rows()[0]
    drawn = paths(run, alignment)
    sections = [Section("Path", _said_of_path(run, alignment), drawn)] if drawn else []
    sections += errors(run, alignment)
    sections += [Section("Measurements", "", [_sensors(run)])] if run.sensors else []
    sections.append(Section("Commands", "What was asked for and what reached the motors.", [_commands(run)]))
    held = show(run)
    sections.append(Section("What the run holds", "", [Table(held.rows()), *_events(run)]))
    kind = run.metadata.get("kind", "run")
    return Page(
        title=run.name,
        subtitle=f"{kind}, {run.duration_s:.1f} s, {len(run.t_ns)} ticks",
        verdict=VERDICTS.get(judged["verdict"], ""),
        headlines=headlines(judged),
        sections=sections,
        reproduce=f"baqueano report {run.name}",
    )


def headlines(judged: dict) -> list[Headline]:
    """The figures of a comparison that are known, large."""
    wanted = (
        ("across_true_rms_m", "across the path, true", "rms", 100, "cm"),
        ("ate_m", "position error", "rms against truth", 100, "cm"),
        ("speed_error_m_s", "speed error", "rms against truth", 1000, "mm/s"),
        ("nees_velocity", "NEES of the velocity", f"{judged['nees_velocity_is']}; 1 is ideal", 1, ""),
        ("nis", "NIS", f"{judged['nis_is']}; 1 is ideal", 1, ""),
    )
    return [
        Headline(label, f"{judged[key] * scale:.3g} {unit}".strip(), note)
        for key, label, note, scale, unit in wanted
        if judged.get(key) is not None and np.isfinite(judged[key])
    ]


def _said_of_path(run: Run, alignment: str) -> str:
    said = (
        "Shaded: where the filter believes the vehicle to be, with 95 % probability." if run.estimate else ""
    )
    laid = {"none": "", "start": " The estimate is laid on the truth at its start.",
            "rigid": " The estimate is laid on the truth by the best rigid motion."}[alignment]  # fmt: skip
    return said + laid


def paths(run: Run, alignment: str = "none") -> list[Table | Drawing]:
    """The drawing of where a run went: reference, truth, estimate with its 95 % ellipses, whichever it holds."""
    lines, ellipses = {}, []
    if run.asked is not None and len(run.asked.t_ns) > 1:
        lines["reference"] = run.asked.eta[:, :2]
    if run.truth is not None:
        lines["truth"] = run.truth.eta[np.isfinite(run.truth.eta).all(axis=1), :2]
    if run.estimate is not None:
        eta = run.estimate.eta
        if run.truth is not None:
            eta = aligned(eta, poses_at(run.estimate.t_ns, run.truth.t_ns, run.truth.eta), alignment)
        lines["estimate"] = eta[:, :2]
        places = np.linspace(0, len(eta) - 1, ELLIPSES).astype(int)
        ellipses = [(eta[k, :2], run.estimate.cov[k, :2, :2]) for k in places]
    if not lines:
        return []
    return [draw(figures.paths(lines, ellipses), f"The path of {run.name}; an ellipse holds 95 %.")]


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


def _sensors(run: Run) -> Drawing:
    panels = []
    for name, channel in run.sensors.items():
        t = seconds(channel.t_ns, run.t_ns[0])
        for k in range(channel.z.shape[1]):
            label = IMU[k] if name == "imu" and channel.z.shape[1] == 3 else f"{name}[{k}]"
            panels.append((label, {"measured": (t, channel.z[:, k])}))
    return draw(figures.over_time(panels), "What the sensors said.")


def _commands(run: Run) -> Drawing:
    t = seconds(run.t_ns, run.t_ns[0])
    panels, names = [], _command_names(run)
    for k in range(run.applied.shape[1]):
        curves = {"applied": (t, run.applied[:, k])}
        if run.requested is not None:
            curves = {"reference": (t, run.requested[:, k]), **curves}
        panels.append((names[k] if k < len(names) else f"u[{k}]", curves))
    return draw(figures.over_time(panels), "Commands: asked for (grey) and applied.")


def _command_names(run: Run) -> list[str]:
    """As the vehicle file of the run calls its commands."""
    try:
        return [str(name) for name in tomllib.loads(run.vehicle_text)["command"]["names"]]
    except (tomllib.TOMLDecodeError, KeyError, TypeError):
        return []


def _events(run: Run) -> list[Table | Drawing]:
    rows = [
        {"t [s]": float(seconds(e.t_ns, run.t_ns[0])), "level": e.level, "by": e.source, "what": e.text}
        for e in run.events
    ]
    return [Table(rows, "What was noticed.")] if rows else []
