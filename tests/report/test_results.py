"""The outputs of a result: a short print, a card, a figure with a custom style, a data frame."""

import ast
import re
import sys
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure

import baqueano as bq
from baqueano.calibration.at_rest import measure_at_rest
from baqueano.calibration.result import CalibratedNumber, Calibration
from baqueano.contracts.result import MAX_LINES, Result
from baqueano.diagnostics import Severity, note
from baqueano.drive import FirstDrive, TeachResult
from baqueano.drive.closure import Closure
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from baqueano.messages import language
from baqueano.report import card, figures
from baqueano.report.canvas import Canvas, resize_figure, with_width
from baqueano.report.fit_report import fit_page, fit_sections
from baqueano.report.page import Drawing, Page, Section, Table
from baqueano.report.pages.result_page import build_page
from baqueano.report.plots import make_drawings
from baqueano.runs.importing.recordings import ImportedRun
from baqueano.simulate import simulate_many
from baqueano.study.demo import GAIN_HEADINGS
from baqueano.validation import forecast
from baqueano.validation.held_out import validate
from baqueano.validation.parameter_drift import ParameterChange, ParameterHistory
from tests.catalogues import read_catalogue
from tests.codes import refused
from tests.figure_files import width_mm
from tests.study.test_controllers import result as compared_controllers

MM = 1.0 / 25.4
ROOT = Path(__file__).parents[2]


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
        "lesson": bq.teach(small, circle(0.3, 0.2)),
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
        "examined route": bq.routes.examine(circle(0.3, 0.2), small),
        "controllers": compared_controllers(0.5),
        "at rest": measure_at_rest(bq.simulate(small, np.zeros((1000, 3)))),
        "closure": Closure("imu", 1, 6.3, 1.003, 0.004, {"sensors.imu.gyro_scale": 1.003}, {}, None),
    }


def history(fit) -> ParameterHistory:
    """Two runs; the second parameter changed between them."""
    estimate, std = np.stack([fit.estimate, 1.2 * fit.estimate]), np.stack([fit.std, fit.std])
    change = ParameterChange(fit.names[1], "N", "step", ("a", "b"), 1.0, 0.1, 1.2, 0.1, 3.0)
    return ParameterHistory(fit.names, ("N", "N s/m"), ("a", "b"), ("", ""), estimate, std, estimate, std, fit.cov,
                            estimate, std, np.zeros(2), (change,), (), fit)  # fmt: skip


NAMES = ("run", "fit", "comparison", "tuning", "forecast", "corridor", "many", "first drive", "validation",
         "calibration", "history", "closure", "noise", "examined route", "controllers", "at rest", "check")  # fmt: skip
DRAWN = (*NAMES[:-1], "lesson", "route", "import")
BEGINS = {"svg": b"<?xml", "pdf": b"%PDF", "png": b"\x89PNG"}
REPORTS = ("fit", "comparison", "corridor", "history", "at rest", "lesson")
CARDS = (*NAMES, "lesson", "route", "import", "vehicle")


@pytest.mark.parametrize("name", CARDS)
def test_a_result_prints_in_few_lines(results, name):
    assert len(repr(results[name]).splitlines()) <= MAX_LINES


@pytest.mark.parametrize("name", NAMES)
def test_a_result_has_a_full_table(results, name):
    result = results[name]
    assert isinstance(result, Result)
    assert str(result) == repr(result)
    assert len(result.table()) >= len(str(result)) / 2


@pytest.mark.parametrize("name", CARDS)
def test_a_result_is_an_html_card_without_a_script(results, name):
    card = results[name]._repr_html_()
    assert card.startswith('<div class="baqueano">')
    assert "<script" not in card
    assert len(re.findall("<tr>", card)) <= MAX_LINES + 2


@pytest.mark.parametrize(("name", "ending"), [*zip(DRAWN, cycle(BEGINS), strict=False)])
def test_a_result_can_be_drawn_at_the_width_of_a_journal_column(results, name, ending, tmp_path):
    figure = results[name].plot(width="column")
    assert isinstance(figure, Figure)
    assert figure.get_figwidth() == pytest.approx(88.0 * MM)
    figure.savefig(tmp_path / f"it.{ending}")
    assert (tmp_path / f"it.{ending}").read_bytes().startswith(BEGINS[ending])
    assert ending != "png" or figure._repr_png_().startswith(BEGINS["png"])


@pytest.mark.parametrize("kind", ["path", "errors", "speed", "commands", "sensors"])
def test_each_plot_of_a_run_is_drawn(results, kind):
    assert results["run"].plot(kind, width=120).get_figwidth() == pytest.approx(120 * MM)


@pytest.mark.parametrize("kind", ["estimates", "data", "residuals", "correlation"])
def test_each_plot_of_a_fit_is_drawn(results, kind):
    assert results["fit"].plot(kind, width="page").axes


def test_the_legend_of_a_comparison_is_in_the_language_of_the_user(results):
    language.choose_language("es")
    try:
        legend = results["comparison"].plot().axes[0].get_legend()
    finally:
        language.choose_language("")
    names = [text.get_text() for text in legend.get_texts()]
    assert {"error de posición", "según la estimación"} <= set(names)


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
    with refused(code, UsageError):
        results["run"].plot(**options)


def test_a_result_without_a_plot_is_refused(results):
    with refused("front.nothing-to-draw", UsageError):
        results["check"].plot()


def test_a_comparison_without_estimates_is_not_drawn():
    at_rest = bq.compare(bq.simulate(bq.load("small"), np.zeros((20, 3))))
    with refused("front.nothing-to-draw", UsageError):
        at_rest.plot()
    assert bq.report(at_rest).drawings() == {}


def test_the_figure_of_a_route_shows_the_limits_of_its_vehicle(results):
    slow = results["examined route"]
    speed, turn, command = slow.plot().axes
    (drive_line, limit), (_, left, right) = speed.lines, turn.lines
    assert np.all(drive_line.get_ydata() < limit.get_ydata())
    np.testing.assert_array_equal(left.get_ydata(), -right.get_ydata())
    assert max(command.lines[0].get_ydata()) == pytest.approx(100.0 * slow.command_share)
    fast = bq.routes.examine(circle(0.3, 2.0), bq.load("small"))
    drive_line, limit = fast.plot().axes[0].lines
    assert np.all(drive_line.get_ydata() > limit.get_ydata())
    assert [len(axes.lines) for axes in bq.routes.examine(circle(0.3, 0.2)).plot().axes] == [1, 1]


def test_the_figure_of_the_noise_has_a_row_per_standard_deviation(results):
    axes = results["noise"].plot().axes[0]
    rows = [row for row in results["noise"].rows() if row["unit"] != "s"]
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [row["std"] for row in rows])
    assert axes.get_yticklabels()[0].get_text() == "imu[0] [m/s²]"


def test_the_figure_of_the_controllers_has_a_panel_per_evaluation(results):
    for kind, expected in (("errors", 10.0), ("ratios", 0.5)):
        figure = results["controllers"].plot(kind)
        assert [axes.get_title(loc="left") for axes in figure.axes] == ["pose", "estimate", "truth"]
        assert figure.axes[0].lines[0].get_xdata()[1] == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_converted_to_a_data_frame(results, name):
    frame = results[name].to_pandas()
    assert len(frame) == (len(results["run"].t_ns) if name == "run" else len(results[name].rows()))


def test_the_data_frame_of_a_run_has_a_row_per_tick(results):
    run, frame = results["run"], results["run"].to_pandas()
    assert frame.index.name == "t_s"
    np.testing.assert_array_equal(frame["estimate.x_m"], run.estimate.eta[:, 0])
    np.testing.assert_allclose(frame["imu[2]"].dropna(), run.sensors["imu"].z[:, 2])


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
    assert [width_mm(path) for path in files] == pytest.approx([88.0] * len(files), abs=0.1)
    assert "<iframe" in page._repr_html_()
    assert repr(bq.report(results["fit"])).startswith("Page('Fit of small'")
    with refused("front.format-unknown", UsageError):
        page.save_figures(tmp_path, "gif")


@pytest.mark.parametrize("name", REPORTS)
def test_the_figures_of_every_report_have_the_requested_format_and_width(results, name, tmp_path):
    file_format, width, mm = (("svg", "column", 88.0), ("pdf", 60, 60.0), ("png", "page", 181.0))[
        REPORTS.index(name) % 3
    ]
    page = bq.report(results[name], figures=tmp_path, file_format=file_format, width=width)
    files = sorted(tmp_path.iterdir())
    assert [path.name for path in files] == [f"{drawing}.{file_format}" for drawing in page.drawings()]
    assert len(files) >= 1
    assert [width_mm(path) for path in files] == pytest.approx([mm] * len(files), abs=0.1)


def test_the_report_of_an_import_or_a_first_drive_is_the_report_of_its_run():
    assert (
        build_page.dispatch(ImportedRun)
        is build_page.dispatch(FirstDrive)
        is build_page.dispatch(TeachResult)
    )


@pytest.mark.parametrize("page", ["docs/python.md", "docs/es/python.md"])
def test_the_page_on_python_names_each_drawing(results, page):
    text = (ROOT / page).read_text(encoding="utf-8")
    kinds = {kind for result in results.values() for kind in make_drawings(result)}
    assert {kind for kind in kinds if f"`{kind}`" not in text} == set()


NAMES_OF_CURVES = ("estimate", "truth", "0002-replay-0001-experiment")


@pytest.fixture
def figure_over_time():
    t = np.arange(5.0)
    return figures.draw_time_series([("a [m]", dict.fromkeys(NAMES_OF_CURVES, (t, t)))])


@pytest.mark.parametrize("width", ["column", 60])
def test_the_legend_of_a_narrow_figure_is_inside_the_figure(figure_over_time, width):
    figure = resize_figure(figure_over_time, width)
    figure.draw_without_rendering()
    legend = figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == [*NAMES_OF_CURVES]
    assert legend.get_window_extent().x1 <= figure.get_figwidth() * figure.dpi


def test_a_figure_has_its_former_size_and_letters_after_it_was_written(figure_over_time, tmp_path):
    page = Page("t", "", "", [], [Section("s", "", [Drawing(figure_over_time, "c")])])
    sizes = sizes_of(figure_over_time, 9)
    (path,) = page.save_figures(tmp_path, "svg", "column")
    assert width_mm(path) == pytest.approx(88.0, abs=0.1)
    assert sizes_of(figure_over_time, 9) == sizes
    with with_width(figure_over_time, "column") as figure:
        width, letters = sizes_of(figure, 21)  # new ticks too
        assert width < sizes[0]
        assert max(letters) < min(sizes[1])
    assert sizes_of(figure_over_time, 21) == sizes


def sizes_of(figure, ticks: int) -> tuple[float, set[float]]:
    """Return the width of a figure, and the sizes of its letters if the axis has this number of ticks."""
    (axes,) = figure.axes
    axes.set_xticks(np.linspace(0.0, 4.0, ticks))
    texts = [axes.yaxis.label, *axes.get_xticklabels(), *axes.get_legend().get_texts()]
    return figure.get_figwidth(), {text.get_fontsize() for text in texts}


@pytest.mark.parametrize(
    ("options", "code"),
    [({"file_format": "gif"}, "front.format-unknown"), ({"width": "colum"}, "front.width-unknown")],
)
def test_figures_of_an_unknown_format_or_width_are_refused_before_the_page_is_written(
    results, tmp_path, options, code
):
    with refused(code, UsageError):
        bq.report(results["run"], tmp_path / "run.html", figures=tmp_path, **options)
    assert not list(tmp_path.iterdir())


def test_a_report_of_an_unsupported_result_is_refused(results):
    with refused("front.no-page", UsageError):
        bq.report(results["many"])


def test_a_vehicle_file_is_printed_in_two_lines(results):
    assert repr(bq.load("small")) == (
        "small (garage: small): Planar at 100 Hz, commands u_x, u_y, u_psi [duty],\n  sensors imu"
    )


def test_each_result_is_printed_in_the_language_of_the_user(results):
    objects = results | {"page": bq.report(results["fit"])}
    english = {name: repr(result) for name, result in objects.items()}
    language.choose_language("es")
    try:
        spanish = {name: repr(result) for name, result in objects.items()}
    finally:
        language.choose_language("")
    assert not [name for name, text in english.items() if text == spanish[name] != "USABLE"]


def test_the_residuals_of_a_fit_are_drawn_over_time(results):
    html = fit_page(results["fit"]).html()
    assert "Residuals over time" in html
    assert html.count("autocorrelation") >= 1


def test_messages_on_a_page_are_ordered_by_severity(results):
    notes = (
        note("fit.duty-step", steps=255),
        note("fit.most-poor", Severity.WARNING, total=9, weak_count=5, reason=""),
    )
    section = fit_sections(replace(results["fit"], notes=notes), reasons=False)[0]
    items = " ".join(section.items)
    assert items.index("poorly identified") < items.index("duty_step was added")


def test_a_wide_table_of_gains_scrolls_inside_its_card(results):
    assert set(GAIN_HEADINGS) <= set(results["tuning"].rows()[0])
    html = Page("t", "", "", [], [Section("s", "", [Table(results["tuning"].rows())])]).html()
    assert '<div class="scroll"><table class="cards">' in html
    assert ".scroll { overflow-x: auto;" in html
    assert re.search(r"@media[^{]*max-width[^{]*\{[^@]*\.cards tr \{ display: grid", html, re.DOTALL)


def test_a_saved_figure_equals_that_of_matplotlib(tmp_path):
    files = tmp_path / "canvas.svg", tmp_path / "figure.svg"
    for kind, file in zip((Canvas, Figure), files, strict=True):
        figure = kind(layout="constrained")
        for axes in figure.subplots(2, 1):
            axes.plot([0.0, 1e5], [0.0, 1.0], label="a long label of a line")
            axes.set_ylabel("one\nlabel")
            axes.legend()
        with rc_context({"svg.fonttype": "none", "svg.hashsalt": "baqueano"}):
            figure.savefig(file, metadata={"Date": None})
    assert files[0].read_bytes() == files[1].read_bytes()


def test_each_heading_of_a_card_is_in_the_catalogue():
    """A heading is a key of a row, so gettext finds it only if it is marked."""
    source = ast.parse(Path(card.__file__).read_text(encoding="utf-8"))
    rows = [n for node in ast.walk(source) if isinstance(node, ast.List | ast.ListComp | ast.Tuple)
            for n in ast.walk(node) if isinstance(n, ast.Dict)]  # fmt: skip
    headings = {ast.literal_eval(key.args[0] if isinstance(key, ast.Call) else key)
                for row in rows for key in row.keys if isinstance(key, ast.Constant | ast.Call)}  # fmt: skip
    translated_ids = {entry.id for entry in read_catalogue("es")}
    assert len(headings) > 20
    assert {heading for heading in headings if heading.replace("_", " ") not in translated_ids} == {"± 95 %"}
