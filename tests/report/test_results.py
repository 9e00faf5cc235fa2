"""The outputs of a result: a short print, a card, a figure with a custom style, a data frame."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import baqueano as bq
from baqueano.contracts.result import MAX_LINES, Result
from baqueano.diagnostics import Severity, note
from baqueano.drive import FirstDrive
from baqueano.drive.closure import Closure
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from baqueano.identify import forecast
from baqueano.identify.parameter_drift import ParameterChange, ParameterHistory
from baqueano.identify.sensor_calibration import CalibratedNumber, Calibration
from baqueano.identify.validation import validate
from baqueano.report.fit_report import page_of_fit, sections_of_fit
from baqueano.report.page import Page, Section, Table
from baqueano.runs.importing.recordings import ImportedRun
from baqueano.simulate import simulate_many

MM = 1.0 / 25.4


@pytest.fixture(scope="module")
def results():
    small = bq.load("small")
    u = bq.excitation("random_steps", small.command.limit, 10.0, small.rate_hz)
    run = bq.experiment(small, u)
    fit = bq.identify(run, small, ["model.actuator_matrix[0,0]", "model.friction.linear[0]"])
    repetition = bq.repeat(small, circle(0.3, 0.2))
    return {
        "run": repetition,
        "fit": fit,
        "comparison": bq.compare(
            [repetition, bq.replay(repetition, estimator="dead_reckoning")], names=["one", "other"]
        ),
        "tuning": bq.tune(small, circle(0.3, 0.2), gains=["k_chi"], starts=1, polish=False, duration_s=2.0),
        "forecast": forecast(fit, run),
        "corridor": bq.forecast(small, circle(0.3, 0.2), 2),
        "many": simulate_many(fit.vehicle_file, u, 5, every_s=5.0),
        "check": bq.check(bq.controllers.PdFeedforward),
        "noise": bq.measure_noise(fit, run),
        "lesson": bq.teach(small, [(1.0, [0.6, 0.0, 0.0]), (1.0, [0.0, 0.0, 0.3])]),
        "route": circle(0.3, 0.2),
        "vehicle": small,
        "import": ImportedRun(run, ()),
        "first drive": FirstDrive(run, (), (), (), 1.2, np.nan, np.zeros(4)),
        "validation": validate(fit, repetition),
        "calibration": Calibration(
            "lab",
            (
                CalibratedNumber(
                    "sensors.imu.gyro_scale", 1.01, 0.001, 0.002, "1", 1.0, "the truth turns less"
                ),
            ),
            {},
        ),
        "history": history(fit),
        "closure": Closure("imu", 1, 6.3, 1.003, 0.004, {"sensors.imu.gyro_scale": 1.003}, {}, None),
    }


def history(fit) -> ParameterHistory:
    """Two runs; the second parameter changed between them."""
    estimate, sd = np.stack([fit.estimate, 1.2 * fit.estimate]), np.stack([fit.sd, fit.sd])
    change = ParameterChange(fit.names[1], "N", "step", ("a", "b"), 1.0, 0.1, 1.2, 0.1, 3.0)
    return ParameterHistory(fit.names, ("N", "N s/m"), ("a", "b"), ("", ""), estimate, sd, estimate, sd, fit.cov,
                            estimate, sd, np.zeros(2), (change,), (), fit)  # fmt: skip


NAMES = ("run", "fit", "comparison", "tuning", "forecast", "corridor", "many", "first drive", "validation",
         "calibration", "history", "closure", "check", "noise")  # fmt: skip
DRAWN = (*NAMES[:12], "lesson", "route", "import")
CARDS = (*NAMES, "lesson", "route", "import", "vehicle")


@pytest.mark.parametrize("name", NAMES)
def test_a_result_prints_in_few_lines_and_has_a_full_table(results, name):
    result = results[name]
    assert isinstance(result, Result)
    assert len(str(result).splitlines()) <= MAX_LINES
    assert str(result) == repr(result)
    assert len(result.table()) >= len(str(result)) / 2


@pytest.mark.parametrize("name", CARDS)
def test_a_result_is_an_html_card_without_a_script(results, name):
    card = results[name]._repr_html_()
    assert card.startswith('<div class="baqueano">')
    assert "<script" not in card
    assert len(re.findall("<tr>", card)) <= MAX_LINES + 2


@pytest.mark.parametrize("name", DRAWN)
def test_a_result_can_be_drawn_at_the_width_of_a_journal_column(results, name, tmp_path):
    figure = results[name].plot(width="column")
    assert isinstance(figure, Figure)
    assert figure.get_figwidth() == pytest.approx(88.0 * MM)
    for ending, begins in (("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")):
        figure.savefig(tmp_path / f"it.{ending}")
        assert (tmp_path / f"it.{ending}").read_bytes().startswith(begins)
    assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", ["path", "errors", "speed", "commands", "sensors"])
def test_each_plot_of_a_run_is_drawn(results, kind):
    assert results["run"].plot(kind, width=120).get_figwidth() == pytest.approx(120 * MM)


@pytest.mark.parametrize("kind", ["estimates", "data", "residuals", "correlation"])
def test_each_plot_of_a_fit_is_drawn(results, kind):
    assert results["fit"].plot(kind, width="page").axes


def test_a_plot_uses_axes_or_figure_of_the_user(results):
    from matplotlib import rcParams

    before = dict(rcParams)
    figure = Figure()
    axes = figure.subplots()
    assert results["run"].plot(ax=axes) is figure
    assert axes.lines
    assert results["run"].plot("sensors", figure=Figure()).axes
    assert {k: v for k, v in rcParams.items() if before[k] != v} == {}
    axes.set_title("mine")
    assert figure.axes[0].get_title() == "mine"


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"kind": "pth"}, "front.plot-unknown"), ({"width": "colum"}, "front.width-unknown"),
        ({"width": 3}, "front.width-mm"), ({"kind": "errors", "ax": Figure().subplots()}, "front.several-panels"),
    ],
)  # fmt: skip
def test_an_impossible_plot_is_refused(results, options, code):
    with pytest.raises(UsageError) as error_info:
        results["run"].plot(**options)
    assert error_info.value.diagnostic.code == code


def test_a_result_without_a_plot_is_refused(results):
    with pytest.raises(UsageError) as error_info:
        results["check"].plot()
    assert error_info.value.diagnostic.code == "front.nothing-to-draw"


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_converted_to_a_data_frame(results, name):
    frame = results[name].to_pandas()
    assert len(frame) == (len(results["run"].t_ns) if name == "run" else len(results[name].rows()))


def test_the_data_frame_of_a_run_has_a_row_per_tick(results):
    run, frame = results["run"], results["run"].to_pandas()
    assert frame.index.name == "t_s"
    np.testing.assert_array_equal(frame["estimate_x_m"], run.estimate.eta[:, 0])
    np.testing.assert_allclose(frame["imu_2"].dropna(), run.sensors["imu"].z[:, 2])


def test_a_missing_pandas_is_reported_with_the_install_command(results, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(UsageError) as error_info:
        results["run"].to_pandas()
    assert error_info.value.diagnostic.code == "front.missing"
    assert error_info.value.diagnostic.fix == "pip install pandas"


def test_the_figures_of_a_report_are_written_to_files(results, tmp_path):
    page = bq.report(results["run"], tmp_path / "run.html")
    assert (tmp_path / "run.html").is_file()
    files = page.save_figures(tmp_path / "figures", "pdf", "column")
    assert [path.name for path in files[:2]] == ["01-path.pdf", "02-speed.pdf"]
    assert all(path.read_bytes().startswith(b"%PDF") for path in files)
    assert "<iframe" in page._repr_html_()
    assert repr(bq.report(results["fit"])).startswith("Page('Fit of small'")
    with pytest.raises(UsageError) as error_info:
        page.save_figures(tmp_path, "gif")
    assert error_info.value.diagnostic.code == "front.format-unknown"


def test_a_report_of_an_unsupported_result_is_refused(results):
    with pytest.raises(UsageError) as error_info:
        bq.report(results["many"])
    assert error_info.value.diagnostic.code == "front.no-page"


def test_a_route_and_a_vehicle_file_are_printed_in_one_line(results):
    assert repr(circle(0.3, 0.2)).startswith("Route(")
    assert repr(bq.load("small")) == (
        "small (garage: small): Planar at 100 Hz, commands u_x, u_y, u_psi [duty], sensors imu"
    )


def test_the_residuals_of_a_fit_are_drawn_over_time(results):
    html = page_of_fit(results["fit"]).html()
    assert "Residuals over time" in html
    assert html.count("autocorrelation") >= 1


def test_messages_on_a_page_are_ordered_by_severity(results):
    notes = (note("fit.duty-step", steps=255), note("fit.most-weak", Severity.WARNING, asked=9, weak=5))
    section = sections_of_fit(replace(results["fit"], notes=notes), reasons=False)[0]
    assert section.text.index("poorly identified. The runs") < section.text.index("duty_step was added")


def test_a_wide_table_of_gains_scrolls_inside_its_card(results):
    html = Page("t", "", "", [], [Section("s", "", [Table(results["tuning"].rows())])]).html()
    assert '<div class="scroll"><table class="cards">' in html
    assert ".scroll { overflow-x: auto; }" in html
    assert re.search(r"@media[^{]*max-width[^{]*\{[^@]*\.cards tr \{ display: grid", html, re.DOTALL)
