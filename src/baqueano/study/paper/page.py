"""The page of `baqueano study paper`: tables and the paper's two figures, drawn from our own runs."""

import numpy as np

from baqueano.guides.shapes import sinuous_circle
from baqueano.report import Headline, Page, Section, Table, draw, figures
from baqueano.report.of_fit import label
from baqueano.simulate import simulate_loop
from baqueano.study.paper.case_study import CaseStudy, Implied
from baqueano.study.paper.two_models import JudgedModel, rows
from baqueano.vehicle_file import load

SHOWN_S = 30.0
SIGNS = "In the paper's signs. A dash is not observable: u_y is always zero."
SENSORS = "The paper's fig. acceleracion_simulacion: measured in blue, the dynamic model in green."
MODELS = "One step ahead (square roots of R), and as the EKF's model on a run that neither has seen."
CLOSED = (
    "The paper's fig. evaluacion_real, for the simulated small vehicle: reference, truth, and what the EKF with "
    "the dynamic model believes."
)


def page_of_paper(study: CaseStudy, models: tuple[JudgedModel, ...], backend: str = "auto") -> Page:
    """Return everything, on one page."""
    fit = study.fits[0]
    labels = [label(c) for c in fit.channels]
    measured, predicted = (
        np.stack([getattr(c, n) for c in fit.channels], axis=1) for n in ("measured", "predicted")
    )
    t_s = fit.channels[0].t_s
    first = t_s <= t_s[0] + SHOWN_S
    sensors = figures.channels(t_s[first], measured[first], predicted[first], labels)
    loop = simulate_loop(load("small"), sinuous_circle(0.6, 0.08, 5, 0.2), backend=backend)
    assert loop.reference is not None
    assert loop.estimate is not None
    assert loop.truth is not None
    lines = {
        "reference": loop.reference.eta[:, :2],
        "truth": loop.truth.eta[:, :2],
        "estimate": loop.estimate.eta[:, :2],
    }
    over = f"over {len(study.fits)} seeds" if len(study.fits) > 1 else f"seed {study.seeds[0]}"
    return Page(
        title="The paper's case studies",
        subtitle="Grotz et al., A low cost small reconfigurable autonomous vehicle; simulated anew, fitted anew",
        verdict=study.verdict,
        headlines=[
            Headline(
                "largest deviation", f"{np.abs(study.z).max():.1f} sd", f"{len(study.z)} estimates, {over}"
            ),
            Headline("within 1.96 sd", f"{100 * study.inside:.0f} %", "95 % are expected"),
        ],
        sections=[
            Section("Case study I: parameters", SIGNS, [Table(study.rows())]),
            Section("Sensors and model", "", [draw(sensors, SENSORS)]),
            Section("Dynamic and kinematic model", MODELS, [Table(rows(models))]),
            Section("Closed loop", "", [draw(figures.paths(lines), CLOSED)]),
            Section("Case study II: what the printed values imply", "", [Table(Implied().rows())]),
        ],
        reproduce="baqueano study paper",
    )
