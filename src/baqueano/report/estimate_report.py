"""Write the sections of a page about an estimate: path and corridor, errors, innovations, a second estimate."""

import numpy as np

from baqueano.compare import Comparison, RunComparison
from baqueano.compare.corridor import Corridor, run_corridor
from baqueano.compare.divergence import cut_at_divergence
from baqueano.compare.errors import align_trajectory
from baqueano.compare.filter_consistency import STATE_NAMES, FilterConsistency
from baqueano.geometry import map_from_body, wrap
from baqueano.messages.language import translate as _
from baqueano.report import figures
from baqueano.report.page import Drawing, Section, Table, draw
from baqueano.runs import Run
from baqueano.runs.interpolation import interpolate_poses, interpolate_rows
from baqueano.signals import seconds

MAX_CORRIDOR_POINTS = 400  # of the corridor, along a path


def comparison_section(comparison: Comparison) -> list[Section]:
    """Return the section that compares two estimates of one drive, with a column for each estimate."""
    rows = [run.row() for run in comparison.runs]
    columns = {
        _("error of the estimated position, rms [m]"): "ate_m", _("at the end [m]"): "end_error_m",
        _("drift over 1 s [m]"): "rpe_m", _("error of the estimated speed, rms [m/s]"): "speed_error_m_s",
        _("NEES of the velocity"): "nees_velocity", "NIS": "nis", _("verdict"): "verdict",
    }  # fmt: skip
    lines = [
        {"figure": label} | {f"run {k}": row[key] for k, row in enumerate(rows)}
        for label, key in columns.items()
    ]
    headings = {"figure": _("figure")} | {f"run {k}": str(row["run"]) for k, row in enumerate(rows)}
    return [
        Section(_("Two estimators, one drive"), "\n".join(comparison.sentences), [Table(lines, "", headings)])
    ]


def path_sentence(comparison: RunComparison, alignment: str) -> str:
    """Return the text above the drawing of a path: its divergence, or its corridor, and its alignment."""
    sentence = f"{comparison.sentences[0]} " if np.isfinite(comparison.divergence_s) else ""
    corridor = comparison.corridor
    if corridor is not None and not sentence:
        lap = " " + _("in the last lap") if _lap_count(corridor) > 1 else ""
        sentence = (
            _("Shaded: where the vehicle may be{lap}, to the left and right of its estimated path.", lap=lap)
            + " "
        )
        sentence += f"{corridor.sentence[:1].upper()}{corridor.sentence[1:]}."
    alignment_sentence = {"none": "", "start": " " + _("The estimate is aligned with the truth at its start."),
            "rigid": " " + _(
                "The estimate is aligned with the truth by the best rigid motion."
            )}[alignment]  # fmt: skip
    return sentence + alignment_sentence


def _lap_count(corridor: Corridor) -> float:
    """Return the length of a corridor in laps, 0 if the length of a lap is unknown."""
    return (
        float(corridor.t_s[-1]) / corridor.lap_s if np.isfinite(corridor.lap_s) and len(corridor.t_s) else 0.0
    )


def paths(run: Run, alignment: str = "none", second: Run | None = None) -> list[Table | Drawing]:
    """Return the drawing of the path of a run: reference, truth, and estimate with the corridor of its last lap.

    The estimate of the run `second` is also drawn. Data that the run does not contain are not drawn.
    """
    run = run.without_rest
    lines: dict[str, np.ndarray] = {}
    band, end = None, None
    if run.guide_reference is not None and len(run.guide_reference.t_ns) > 1:
        lines["reference"] = run.guide_reference.eta[:, :2]
    if run.truth is not None:
        lines["truth"] = run.truth.eta[np.isfinite(run.truth.eta[:, :2]).all(axis=1), :2]
    if run.estimate is not None:
        eta, corridor = _aligned_path(run, alignment), run_corridor(run)
        lines["estimate"] = eta[:, :2]
        if corridor is not None and len(corridor.t_s) > 1:
            last_index = len(corridor.t_s) - 1
            begin_index = (
                int(np.searchsorted(corridor.t_s, corridor.t_s[-1] - corridor.lap_s))
                if _lap_count(corridor) > 1.0
                else 0
            )
            indices = np.linspace(
                begin_index, last_index, min(MAX_CORRIDOR_POINTS, last_index + 1 - begin_index)
            ).astype(int)
            left_normal = np.stack([-np.sin(eta[indices, 2]), np.cos(eta[indices, 2])], axis=1)
            edge_offset = corridor.across_m[indices, None] * left_normal
            band = np.stack([eta[indices, :2] + edge_offset, eta[indices, :2] - edge_offset], axis=1)
            turn = map_from_body(eta[last_index, 2] - corridor.eta[last_index, 2])[:2, :2]
            end = figures.ellipse(eta[last_index, :2], turn @ run.estimate.cov[last_index, :2, :2] @ turn.T)
    if second is not None and second.estimate is not None:
        second_run = cut_at_divergence(second)
        assert second_run.estimate is not None
        lines[second.name] = _aligned_path(second_run, alignment)[:, :2]
    if not lines:
        return []
    caption = _("The path of {run}.", run=run.name)
    if band is not None:
        caption = _("The path of {run}, and the region that contains it with 95 % probability.", run=run.name)
    return [draw(figures.paths(lines, band, end), caption)]


def _aligned_path(run: Run, alignment: str) -> np.ndarray:
    """Return the estimated poses (N, 3), aligned with the truth if there is one."""
    assert run.estimate is not None
    if run.truth is None:
        return run.estimate.eta
    return align_trajectory(
        run.estimate.eta, interpolate_poses(run.estimate.t_ns, run.truth.t_ns, run.truth.eta), alignment
    )


def errors(run: Run, alignment: str = "none", second: Run | None = None) -> list[Section]:
    """Return the section of the errors against the truth with the filter's ±2σ; [] without a truth.

    The errors of the run `second` are drawn as a line.
    """
    if run.estimate is None or run.truth is None or len(run.truth.t_ns) < 2:
        return []
    t, error = _truth_errors(run, run, alignment)
    band = 2.0 * np.sqrt(np.maximum(np.einsum("kii->ki", run.estimate.cov[:, :4, :4]), 0.0))
    second_errors = {}
    if second is not None and second.estimate is not None:
        second_errors[second.name] = _truth_errors(cut_at_divergence(second), run, alignment)
    panels = []
    for k, label in enumerate(
        (_("x error [m]"), _("y error [m]"), _("heading error [°]"), _("ν_x error [m/s]"))
    ):
        scale = 180.0 / np.pi if k == 2 else 1.0
        if np.isfinite(error[:, k]).any():
            curves = {"±2σ": (t, scale * band[:, k]), "estimate": (t, scale * error[:, k])}
            panels.append(
                (
                    label,
                    curves | {n: (second_t, scale * e[:, k]) for n, (second_t, e) in second_errors.items()},
                )
            )
    if not panels:
        return []
    drawing = draw(
        figures.draw_time_series(panels),
        _("Estimate minus truth; the band is the uncertainty that the filter reports."),
    )
    return [Section(_("Errors against the truth"), "", [drawing])]


def _truth_errors(run: Run, truth_run: Run, alignment: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s], and the errors (N, 4) of x, y, ψ, ν_x: estimate minus truth, with the heading wrapped."""
    log, truth = run.estimate, truth_run.truth
    assert log is not None
    assert truth is not None
    error = _aligned_path(run, alignment) - interpolate_poses(log.t_ns, truth.t_ns, truth.eta)
    error[:, 2] = wrap(error[:, 2])
    nu_true = interpolate_rows(log.t_ns, truth.t_ns, truth.nu)
    return seconds(log.t_ns, run.start_ns), np.column_stack([error, log.nu[:, 0] - nu_true[:, 0]])


def consistency_sections(corridor: FilterConsistency, run: Run) -> list[Section]:
    """Return the section on the consistency of the filter: sentence, values and innovations; [] without data."""
    quantities = {"pose": _("pose"), "velocity": _("velocity")} | {
        k: _(title) for k, title in STATE_NAMES.items()
    }
    names = {f"nees_{key}": f"NEES: {title}" for key, title in quantities.items()}
    names |= {"nis": _("NIS: all innovations")}
    names |= {f"nis[{k}]": f"NIS: {name}" for k, name in enumerate(corridor.channels)}
    columns = ("figure", "value", "verdict", "from", "to", "independent samples")
    rows = [
        {key: row[key] for key in columns} | {"figure": names[row["figure"]]} for row in corridor.figures()
    ]
    log = run.estimate
    caption = _(
        "1 if the filter is consistent; a correct covariance gives a value between the "
        "two limits in 95 % of runs."
    )
    parts: list[Table | Drawing] = [Table(rows, caption)]
    if log is not None and log.innovation is not None and log.innovation_cov is not None:
        t, two = seconds(log.t_ns, run.start_ns), np.full(len(log.t_ns), 2.0)
        std = np.sqrt(np.diagonal(log.innovation_cov, axis1=1, axis2=2))
        panels = [
            (name, {"±2σ": (t, two), "residual": (t, y)})
            for name, y in zip(corridor.channels, (log.innovation / std).T, strict=True) if np.isfinite(y).any()
        ]  # fmt: skip
        remark = _(
            "Innovations over time, in standard deviations: with a correct covariance 95 % are in the band."
        )
        parts += [draw(figures.draw_time_series(panels, height_in=1.4), remark)] if panels else []
    return [Section(_("Consistency of the filter"), corridor.sentence, parts)] if rows else []
