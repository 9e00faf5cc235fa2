"""A report is one self-contained file: it loads no other file, every name is escaped, and an unknown value is a
dash.
"""

import re
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from baqueano.compare import compare
from baqueano.compare.filter_consistency import STATE_NAMES, filter_consistency
from baqueano.monitor import REJECTIONS_SOURCE, Rejections, rejection_event
from baqueano.report import Headline, Page, Section, Table, draw, figures
from baqueano.report.fit_report import fit_page
from baqueano.report.run_report import run_page
from baqueano.runs import Channel, EstimateLog, Event, ReferenceLog, Run, TruthLog
from baqueano.vehicle_file import load
from tests.catalogues import read_catalogue

mpl.use("svg")
ADDRESS = re.compile(r"""(?:src|href|xlink:href|action)\s*=\s*["'](?!#|data:)|url\((?!\s*["']?#)|@import""")
EVIL = "<script>alert('ñ')</script> & \"co\""


def a_run(name: str = "0001-test", N: int = 400) -> Run:
    random = np.random.default_rng(0)
    t_ns = 10_000_000 * np.arange(N)
    turn = np.linspace(0, 3, N)
    eta = np.column_stack([np.sin(turn), 1 - np.cos(turn), turn])
    nu = np.column_stack([np.full(N, 0.75), np.zeros(N), np.full(N, 0.75)])
    cov = np.tile(1e-4 * np.eye(6), (N, 1, 1))
    return Run(
        name=name,
        path=None,
        t_ns=t_ns,
        applied_commands=random.normal(size=(N, 3)),
        requested_commands=random.normal(size=(N, 3)),
        sensors={"imu": Channel(t_ns, t_ns, random.normal(size=(N, 3)))},
        estimate=EstimateLog(t_ns, eta + 0.01 * random.normal(size=(N, 3)), nu, cov, None, None),
        reference=ReferenceLog(t_ns, eta, nu, np.zeros(N)),
        truth=TruthLog(t_ns, eta, nu, np.zeros((N, 3))),
        events=(Event(int(t_ns[3]), "warning", "supervisor", EVIL),),
        vehicle_text="",
        metadata={"kind": "repeat"},
        sent_commands=None,
    )


@cache
def whole_page() -> Page:
    return run_page(a_run())


def parts_of(page: Page) -> dict[str, list[Any]]:
    return {section.title: list(section.parts) for section in page.sections}


def assert_stands_alone(text: str) -> None:
    assert text.lstrip().lower().startswith("<!doctype html>")
    assert not ADDRESS.search(text)
    assert "<script" not in text.lower()
    assert 'charset="utf-8"' in text.lower()


def test_ne8_a_page_fetches_no_file_and_runs_no_script():
    text = whole_page().html()
    assert_stands_alone(text)
    assert text.count("<svg") >= 4
    assert "baqueano report 0001-test" in text


def test_the_verdict_of_a_page_is_the_verdict_of_the_comparison():
    assert whole_page().verdict == compare(a_run()).verdict


def test_rejected_readings_have_a_table_only_if_they_were_counted():
    counts = Event(0, "info", REJECTIONS_SOURCE, "", rejection_event([Rejections("imu[2]", 12, 400)]))
    run = replace(a_run(), events=(counts,))
    (table,) = parts_of(run_page(run))["Rejected readings"]
    assert table.rows == [{"channel": "imu[2]", "readings": 400, "rejected": 12, "rejected [%]": 3.0}]
    assert "Rejected readings" not in parts_of(whole_page())


def test_each_heading_of_a_page_is_in_the_catalogue():
    counts = Event(0, "info", REJECTIONS_SOURCE, "", rejection_event([Rejections("imu[2]", 12, 400)]))
    parts = [
        part for section in run_page(replace(a_run(), events=(counts,))).sections for part in section.parts
    ]
    rows = [part.rows[0] for part in parts if isinstance(part, Table) and part.columns is None]
    headings = {key.replace("_", " ") for row in rows for key in row if "[" not in key}
    assert {"rejected", "independent samples"} <= headings <= {entry.id for entry in read_catalogue("es")}


def test_names_and_events_are_escaped():
    text = run_page(a_run(EVIL)).html()
    assert_stands_alone(text)
    assert "&lt;script&gt;" in text


def test_a_caption_is_escaped_in_the_label_of_its_drawing():
    drawing = draw(figures.paths({EVIL: np.zeros((2, 2))}), EVIL)
    assert "<script" not in drawing.svg
    assert 'aria-label="&lt;script&gt;' in drawing.svg


def test_an_unknown_value_is_printed_as_a_dash_and_never_nan():
    rows = [
        {"name": "a", "value": np.nan, "std": None, "seen": True},
        {"name": "b", "value": 1.23456789, "std": 0.5},
    ]
    page = Page("t", "s", "WARN", [Headline("h", "1")], [Section("x", parts=[Table(rows)])])
    text = page.html()
    cells = re.findall(r"<td[^>]*>\s*(.*?)\s*</td>", text, re.DOTALL)
    assert "nan" not in text.lower()
    assert cells.count("–") >= 2
    assert {"1.235", "0.5", "yes"} <= set(cells)


@pytest.mark.parametrize("verdict", ["USABLE", "OK", "WARN", "REFUSED", "STOPPED", ""])
def test_a_page_can_show_every_verdict(verdict):
    assert_stands_alone(Page("t", "s", verdict, [], []).html())


@pytest.mark.parametrize("without", ["truth", "estimate", "reference", "requested_commands"])
def test_a_page_can_show_an_incomplete_run(without):
    assert_stands_alone(run_page(replace(a_run(), **{without: None})).html())


def test_a_page_can_show_a_run_with_only_commands():
    run = replace(
        a_run(), truth=None, estimate=None, reference=None, requested_commands=None, sensors={}, events=()
    )
    assert_stands_alone(run_page(run).html())
    assert "Path" in [section.title for section in whole_page().sections]
    assert "Path" not in [section.title for section in run_page(run).sections], "an empty card"


def test_a_drive_shows_its_speed_and_its_commands_with_their_limits():
    run = replace(a_run(), vehicle_text=load("small").text)
    page = run_page(run)
    parts = parts_of(page)
    labels = {headline.label: headline.value for headline in page.headlines}
    assert labels["error of the speed from its reference"] == "0 %"
    assert float(labels["at a limit"].split()[0]) > 50.0  # of unit normals on two wheels
    speed, commands = (parts[title][0].svg for title in ("Speed", "Commands"))
    assert all(f">{name}<" in speed for name in ("truth", "estimate", "reference"))
    assert all(
        f">{name}<" in commands for name in ("requested", "limit", "at its limit", "right wheel [duty]")
    )
    rows = parts["Commands"][1].rows
    assert [row["command"] for row in rows][-2:] == ["left wheel [duty]", "right wheel [duty]"]
    assert all(
        row["limit"] == 1.0 and row["at its limit [% of ticks]"] > 10.0
        for row in rows
        if "wheel" in row["command"]
    )


def test_without_a_vehicle_file_a_page_shows_no_limits():
    page = whole_page()
    rows = parts_of(page)["Commands"][1].rows
    assert [row["command"] for row in rows] == ["u[0]", "u[1]", "u[2]"]
    assert all(row["limit"] is None and row["at its limit [% of ticks]"] is None for row in rows)
    assert "at a limit" not in {headline.label for headline in page.headlines}


def test_an_unused_command_entry_is_not_drawn():
    run = a_run()
    applied_commands = run.applied_commands.copy()
    applied_commands[:, 1] = 0.0
    page = run_page(
        replace(
            run, applied_commands=applied_commands, requested_commands=None, vehicle_text=load("small").text
        )
    )
    rows = parts_of(page)["Commands"][1].rows
    assert [row["command"] for row in rows] == [
        f"{n} [duty]" for n in ("u_x", "u_psi", "left wheel", "right wheel")
    ]


def test_a_page_can_show_a_run_with_gaps_and_missing_truth():
    run = a_run()
    assert run.truth is not None
    lost_truth = TruthLog(
        run.truth.t_ns, run.truth.eta.copy(), np.full((400, 3), np.nan), np.full((400, 3), np.nan)
    )
    lost_truth.eta[100:200] = np.nan
    z = run.sensors["imu"].z.copy()
    z[50:80] = np.nan
    imu = Channel(run.sensors["imu"].t_ns, run.sensors["imu"].arrival_ns, z)
    none = Channel(imu.t_ns[:0], imu.t_ns[:0], z[:0])
    text = run_page(replace(run, truth=lost_truth, sensors={"imu": imu, "silent": none})).html()
    assert_stands_alone(text)


@pytest.mark.parametrize("alignment", ["start", "rigid"])
def test_a_page_can_use_another_alignment(alignment):
    assert_stands_alone(run_page(a_run(), alignment).html())


def test_a_page_is_written_completely_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a folder" / "página.html"
    page = Page("t", "s", "OK", [], [])
    assert page.save(path) == path
    before = path.read_bytes()

    def refuse(*args):
        raise OSError("no room")

    monkeypatch.setattr("os.replace", refuse)
    with pytest.raises(OSError, match="no room"):
        replace(page, title="new").save(path)
    assert path.read_bytes() == before


def test_the_same_run_gives_the_same_bytes():
    assert run_page(a_run()).html() == whole_page().html()


def test_thinning_retains_every_peak():
    t = np.arange(100_000.0)
    y = np.sin(t / 500)
    y[51_234], y[77] = 9.0, -9.0
    y[1000:3000] = np.nan
    few_t, y_few = figures.decimate(t, y)
    assert len(y_few) <= figures.MAX_POINTS + 2
    assert (np.nanmax(y_few), np.nanmin(y_few)) == (9.0, -9.0)
    assert np.all(np.diff(few_t) > 0)
    assert np.isnan(y_few[(few_t > 1100) & (few_t < 2900)]).all()


def test_the_period_of_most_motion_ignores_offsets_and_spikes():
    t_s = 0.01 * np.arange(10_000)
    y = 0.01 * np.random.default_rng(0).normal(size=(10_000, 2))
    y[:, 0] += 5.0 + 1e-4 * np.arange(10_000)  # large, and hardly changing
    y[6000:7000, 0] += np.sin(3.0 * t_s[6000:7000])
    y[100:2000:100, 1] = 50.0  # one spike per second
    y[5000:5500] = np.nan
    part = figures.most_motion(t_s, y, 10.0)
    assert (t_s[part][0], t_s[part][-1]) == pytest.approx((60.0, 70.0))


def test_channels_of_nan_are_shown_completely():
    part = figures.most_motion(0.01 * np.arange(5000), np.full((5000, 2), np.nan), 10.0)
    assert (part.start, part.stop) == (0, 5000)


def test_a_run_shorter_than_the_figure_is_shown_completely():
    t_s = 3.0 + 0.1 * np.arange(101)
    part = figures.most_motion(t_s, np.sin(t_s)[:, None], 10.0)
    assert (part.start, part.stop) == (0, 101)


def test_an_ellipse_covers_95_percent():
    cov = np.array([[4.0, 1.0], [1.0, 2.0]])
    curve = figures.ellipse(np.array([1.0, -1.0]), cov) - [1.0, -1.0]
    assert np.einsum("ki,ij,kj->k", curve, np.linalg.inv(cov), curve) == pytest.approx(5.991)


def test_residuals_of_a_nan_or_constant_channel_are_drawn():
    residual = np.random.default_rng(0).normal(size=(200, 3))
    residual[:, 1] = np.nan
    residual[:, 2] = 0.0
    assert "<svg" in draw(figures.residuals(residual, ["a", "b", "c"]), "r").svg


def test_estimates_with_zero_truth_are_omitted_from_percent_figures():
    drawing = draw(
        figures.estimates(["a", "b"], np.array([1.0, 1.0]), np.array([0.1, 0.1]), np.array([2.0, 0.0])), "e"
    )
    assert ">a<" in drawing.svg
    assert ">b<" not in drawing.svg


def test_the_page_of_a_fit_is_self_contained():
    from baqueano.identify import excitation, identify
    from baqueano.simulate import simulate

    vehicle = load("small")
    u = excitation("random_steps", vehicle.command.limit, 10.0, vehicle.rate_hz, 0)
    fit = identify(
        simulate(vehicle, u, 0), vehicle, ["model.actuator_matrix[0,0]", "model.actuator_matrix[0,1]"]
    )
    assert_stands_alone(fit_page(fit).html())
    assert_stands_alone(fit_page(fit, np.array([3.38, 0.0])).html())


def test_the_page_reports_the_consistency_of_the_filter():
    """The error is 1 cm, 0.01 rad, 1 cm/s and 0.01 rad/s, as in its covariance; then twice as much."""
    run, title = a_run(), "Consistency of the filter"
    nu = run.estimate.nu + 0.01 * np.random.default_rng(1).normal(size=(400, 3))
    run = replace(run, estimate=run.estimate._replace(nu=nu))
    sections = {section.title: section for section in run_page(run).sections}
    assert sections[title].text == filter_consistency(run).sentence
    assert filter_consistency(run).messages[0].code == "consistency.consistent"
    (table,) = sections[title].parts
    assert [row["figure"] for row in table.rows] == [
        "NEES: pose",
        "NEES: velocity",
        *(f"NEES: {name}" for name in STATE_NAMES.values()),
    ]
    log = run.estimate._replace(cov=0.25 * run.estimate.cov)
    doubtful = {section.title: section for section in run_page(replace(run, estimate=log)).sections}
    (table,) = doubtful[title].parts
    assert {row["figure"]: row["verdict"] for row in table.rows}.items() >= {
        "NEES: pose": "too sure",
        "NEES: velocity": "too sure",
    }.items()
    consistency = filter_consistency(replace(run, estimate=log))
    assert doubtful[title].text == consistency.sentence
    assert (consistency.messages[0].code, consistency.messages[0].figures["quantity"]) == (
        "consistency.too-sure",
        "the pose",
    )
    assert consistency.messages[0].figures["mean"] == pytest.approx(3.95, abs=0.05)
    assert title not in [section.title for section in run_page(replace(run, estimate=None)).sections]


def luminance(rgb):
    """Return the relative luminance of a colour (3,) in [0, 1], as WCAG 2 defines it."""
    c = np.clip(rgb, 0.0, 1.0)
    return np.array([0.2126, 0.7152, 0.0722]) @ np.where(
        c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4
    )


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_words_and_lines_of_a_page_stand_out_in_both_themes(theme):
    """The contrast is at least 4.5 for words and 3 for lines, after the filter of the dark figures."""
    style = files("baqueano.report").joinpath("page.html.jinja").read_text(encoding="utf-8")
    light, dark = (dict(re.findall(r"--(\w+): (#\w{6});", part)) for part in style.split("@media screen", 1))
    colours = light if theme == "light" else light | dark
    rgb = {name: np.array([int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)]) for name, c in colours.items()}

    def contrast(first, second):
        low, high = sorted((luminance(first), luminance(second)))
        return (high + 0.05) / (low + 0.05)

    for ground in ("paper", "ground", "code"):
        assert contrast(rgb["ink"], rgb[ground]) > 7.0
        assert contrast(rgb["soft"], rgb[ground]) > 4.5
    share = float(re.search(r"invert\(([.\d]+)\) hue-rotate\(180deg\)", style)[1])
    grey = np.array([0.213, 0.715, 0.072])  # of the filters, which turn a hue about grey
    for colour, minimum in (
        (figures.MEASUREMENT, 3.0), (figures.MODEL, 3.0), (figures.ALARM, 3.0), (figures.TRUTH, 7.0), ("#5c636e", 4.5),
    ):  # fmt: skip
        c = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        inverse = (1.0 - share) * c + share * (1.0 - c)
        page_rgb = c if theme == "light" else 2.0 * grey @ inverse - inverse
        assert contrast(page_rgb, rgb["paper"]) > minimum, colour
