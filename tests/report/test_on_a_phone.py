"""A page on a phone: figures with readable letters, tables as cards, and no content wider than its card."""

import re
from dataclasses import replace

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.drive import repeat
from baqueano.guides.shapes import circle
from baqueano.messages import text as sentence_of, unbroken
from baqueano.report import figures
from baqueano.report.canvas import with_narrow_legends
from baqueano.report.page import NARROW_IN, Page, Section, Table, draw
from baqueano.report.run_report import run_page
from baqueano.vehicle_file import load

# the width inside a card of 390 px; size of the smallest letters
POINTS_PER_IN, PHONE_PX, LEAST_PX = 72.0, 334.0, 6.5


@pytest.fixture(scope="module")
def drive():
    return repeat(load("small"), circle(0.3, 0.3), laps=3, rest_s=0.0)


def lines_of(svg):
    return set(re.findall(r">([^<>]+)</text>", svg))


def test_the_narrow_version_of_a_figure_has_the_same_texts():
    t = np.linspace(0.0, 10.0, 50)
    drawing = draw(figures.draw_time_series([("a [m]", {"truth": (t, t), "estimate": (t, -t)})]), "c").svg
    large, narrow = drawing.split("<svg")[1:]
    width = float(re.search(r'width="([\d.]+)pt"', narrow)[1])
    assert width == pytest.approx(NARROW_IN * POINTS_PER_IN, rel=0.01)
    assert 9.0 * PHONE_PX / width >= LEAST_PX
    assert {"a [m]", "truth", "estimate", "time [s]"} <= lines_of(large) & lines_of(narrow)


def test_the_legend_of_the_narrow_figure_ends_inside_the_figure():
    t, names = np.linspace(0.0, 10.0, 50), ("valor verdadero", "estimación", "referencia", "límite")
    figure = figures.draw_time_series([("a [m]", dict.fromkeys(names, (t, t)))])
    wide_columns = figure.axes[0].get_legend()._ncols
    figure.set_size_inches(NARROW_IN, 2.4)
    with with_narrow_legends(figure):
        figure.draw_without_rendering()
        legend = figure.axes[0].get_legend()
        assert legend.get_window_extent().x1 <= NARROW_IN * figure.dpi
    assert figure.axes[0].get_legend()._ncols == wide_columns


def test_the_wide_and_narrow_figures_share_no_id():
    t = np.linspace(0.0, 10.0, 50)
    large, narrow = (
        set(re.findall(r'id="([mp][0-9a-f]{8,})"', figure))
        for figure in draw(figures.draw_time_series([("a", {"truth": (t, t)})]), "c").svg.split("<svg")[1:]
    )
    assert large
    assert not large & narrow


def test_a_table_of_many_columns_becomes_cards_that_name_each_value():
    rows = [{"parameter": "mass", "estimate": 1.0, "std. error": 0.1, "unit": "kg", "note": ""}]
    text = Page("t", "", "", [], [Section("s", "", [Table(rows), Table([{"a": 1}])])]).html()
    assert text.count('<table class="cards">') == 1
    assert '<td data-heading="std. error" class="number">0.1</td>' in text


def test_a_run_without_ticks_has_a_page(drive):
    empty = drive.cut(1e6)
    for run in (empty, replace(empty, sensors=drive.sensors, events=drive.events, estimate=drive.estimate)):
        assert "</html>" in run_page(run).html()


def test_only_the_last_lap_has_a_corridor(drive):
    from baqueano.report.estimate_report import paths

    def patches(run):
        return len(re.findall(r"\bz\b", paths(run)[0].svg.split("patch_3")[1][:200_000]))

    lap = drive.cut(0.0, drive.duration_s / 3.0)
    assert patches(drive) < 1.5 * patches(lap)


def test_the_report_of_two_estimators_draws_and_judges_both(drive):
    log = drive.estimate
    shifted_log = log._replace(eta=log.eta + np.array([0.1, 0.0, 0.0]))
    second = replace(drive, name="other", estimate=shifted_log, metadata=drive.metadata | {"kind": "replay"})
    text = run_page(second, second=drive).html()
    assert "Two estimators, one drive" in text
    assert len(re.findall(f">{drive.name}</text>", text)) >= 4  # the path and the errors, both shapes
    assert "at a limit" not in text


def test_a_diverged_estimate_is_drawn_until_its_divergence(drive):
    log = drive.estimate
    eta = log.eta.copy()
    eta[500:, 0] = 1e16
    text = run_page(replace(drive, estimate=log._replace(eta=eta))).html()
    assert unbroken(sentence_of(note("compare.diverged", t_s=5.0))) in text
    assert "1e16" not in text
    assert not re.search(r">\d+(\.\d+)?e1\d<|>1e1\d<", text)


def test_residuals_and_innovations_are_drawn_over_time(drive):
    assert "Innovations over time" in run_page(drive).html()
