"""Write the page of `baqueano study paper`: tables and the paper's two figures, drawn from runs of baqueano."""

import numpy as np

from baqueano.guides.shapes import sinuous_circle
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.report import Headline, Page, Section, Table, draw, figures
from baqueano.report.fit_report import label
from baqueano.simulate import simulate_loop
from baqueano.study.paper.case_study import CaseStudy, ImpliedParameters
from baqueano.study.paper.dynamic_vs_kinematic import ModelEvaluation, rows
from baqueano.vehicle_file import load

SHOWN_S = 30.0
SIGNS = N_("Signs as in the paper. A dash means not identifiable: u_y is always zero.")
SENSORS = N_("The paper's fig. acceleracion_simulacion: measured in blue, the dynamic model in green.")
MODELS = N_("One step ahead (square roots of R), and as the EKF's model on a run that neither fit used.")
PATH_CAPTION = N_(
    "The paper's fig. evaluacion_real, for the simulated small vehicle: reference, truth, and the estimate "
    "of the EKF with the dynamic model."
)


def paper_page(study: CaseStudy, models: tuple[ModelEvaluation, ...], backend: str = "auto") -> Page:
    """Return the page with the tables and figures of the case studies."""
    fit = study.fits[0]
    labels = [label(c) for c in fit.channels]
    measured_values, predicted_values = (
        np.stack([getattr(c, n) for c in fit.channels], axis=1) for n in ("measurements", "predictions")
    )
    t_s = fit.channels[0].t_s
    is_shown = t_s <= t_s[0] + SHOWN_S
    sensors = figures.channels(t_s[is_shown], measured_values[is_shown], predicted_values[is_shown], labels)
    loop = simulate_loop(load("small"), sinuous_circle(0.6, 0.08, 5, 0.2), backend=backend)
    assert loop.reference is not None
    assert loop.estimate is not None
    assert loop.truth is not None
    lines = {
        "reference": loop.reference.eta[:, :2],
        "truth": loop.truth.eta[:, :2],
        "estimate": loop.estimate.eta[:, :2],
    }
    seeds_text = _("over {seeds} seeds", seeds=len(study.fits))
    if len(study.fits) == 1:
        seeds_text = _("seed {seed}", seed=study.seeds[0])
    return Page(
        title=_("The paper's case studies"),
        subtitle=_(
            "Grotz et al., A low cost small reconfigurable autonomous vehicle; simulated and fitted again"
        ),
        verdict=study.verdict,
        headlines=[
            Headline(
                _("largest deviation"),
                f"{number(float(np.abs(study.normalised_errors).max())):.1f} σ",
                _("{estimates} estimates, {over}", estimates=len(study.normalised_errors), over=seeds_text),
            ),
            Headline(
                _("within 1.96 std"), f"{100 * study.share_within_interval:.0f} %", _("95 % are expected")
            ),
        ],
        sections=[
            Section(_("Case study I: parameters"), _(SIGNS), [Table(study.rows())]),
            Section(_("Sensors and model"), "", [draw(sensors, _(SENSORS))]),
            Section(_("Dynamic and kinematic model"), _(MODELS), [Table(rows(models))]),
            Section(_("Closed loop"), "", [draw(figures.paths(lines), _(PATH_CAPTION))]),
            Section(
                _("Case study II: what the printed values imply"), "", [Table(ImpliedParameters().rows())]
            ),
        ],
        reproduce="baqueano study paper",
    )
