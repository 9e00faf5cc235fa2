"""A run as an animation: it moves without a script, respects reduced motion, and shows the run."""

import re
import xml.etree.ElementTree as tree
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import baqueano as bq
from baqueano.cli import baqueano
from baqueano.diagnostics import Verdict
from baqueano.errors import AnswerNo, UsageError
from baqueano.guides.shapes import circle
from baqueano.report.animation import picture_file
from baqueano.report.animation.partial_fits import PartialFit
from baqueano.report.animation.picture import animation
from baqueano.report.animation.scene import scene
from baqueano.report.estimate_report import paths
from baqueano.report.run_report import run_page
from baqueano.runs import TruthLog, write_run
from tests.codes import refused

LARGEST = 300_000  # bytes


@pytest.fixture(scope="module")
def run():
    small = bq.load("small")
    return bq.repeat(small, circle(0.4, 0.3), laps=2, truth=small.with_values({"model.mass_kg": 0.7}))


@pytest.fixture(scope="module")
def svg(run):
    return animation(scene(run))


def elements(svg, kind):
    children = tree.fromstring(svg).iter("{http://www.w3.org/2000/svg}" + kind)
    return list(children)


def test_the_animation_is_one_small_file_without_script_or_network(svg):
    assert len(svg.encode()) < LARGEST
    assert not elements(svg, "script")
    assert not [
        link for link in re.findall(r"https?://[^\"' ]+", svg) if link != "http://www.w3.org/2000/svg"
    ]


def test_every_animation_has_ordered_keyframes(svg):
    animations = set(re.findall(r"animation:(\w+) ", svg))
    frames = dict(re.findall(r"@keyframes (\w+)\{((?:[\d.]+%\{[^}]*\})+)\}", svg))
    assert animations == frames.keys()
    for name, steps in frames.items():
        parts = [float(part) for part in re.findall(r"([\d.]+)%\{", steps)]
        assert parts == sorted(parts), name
        assert parts[0] < 10.0, name
        assert parts[-1] <= 100.0, name


def test_the_animation_respects_reduced_motion_and_dark_mode(svg):
    assert "@media(prefers-reduced-motion:reduce){*{animation:none!important}}" in svg
    assert "@media(prefers-color-scheme:dark)" in svg
    hidden_elements = [element for element in elements(svg, "g") if element.get("class") == "gone"]
    trail = [element for element in elements(svg, "g") if "backwards" in (element.get("style") or "")]
    visible = [element for element in trail if element.get("class") != "gone"]
    assert 0.4 * len(trail) < len(visible) < 0.6 * len(trail), "the last of two laps remains visible"
    assert hidden_elements


def test_the_animated_vehicle_follows_its_path(run, svg):
    keyframes = re.search(r"@keyframes v\{(.*?)\}\}", svg)
    assert keyframes is not None
    px = np.array(re.findall(r"translate\((-?[\d.]+)px,(-?[\d.]+)px\)", keyframes.group()), dtype=float)
    truth = scene(run).vehicle_poses[:, :2]
    fit, *_ = np.linalg.lstsq(np.column_stack([truth, np.ones(len(truth))]), px, rcond=None)
    assert np.abs(np.column_stack([truth, np.ones(len(truth))]) @ fit - px).max() < 0.1, "the same shape"
    assert fit[0, 0] == pytest.approx(-fit[1, 1], rel=1e-3), "y up, no direction longer than the other"
    assert (px > 0.0).all()
    assert (px < [450.0, 430.0]).all()


def test_the_animation_shows_shrinking_intervals_of_a_fit(run):
    stages = [PartialFit(10.0, Verdict.WARN, np.array([0.1, np.nan]), np.array([0.5, np.nan])),
              PartialFit(60.0, Verdict.USABLE, np.array([0.0, 0.01]), np.array([0.05, 0.02]))]  # fmt: skip
    drawing = animation(scene(run), stages, ["a < b", "c"])
    first = re.search(r"@keyframes b0\{(.*?)\}\}", drawing)
    assert first is not None
    widths = [float(x) for x in re.findall(r"scaleX\(([\d.]+)\)", first.group(1))]
    assert widths[0] > 3.0 * widths[-1]
    assert max(widths) <= 96.0, "no bar may exceed its axis"
    assert "a &lt; b" in drawing
    assert tree.fromstring(drawing) is not None


def test_a_run_without_truth_and_estimate_cannot_be_animated(run):
    with refused("report.nothing-moves", AnswerNo):
        scene(replace(run, estimate=None, truth=None))
    with refused("report.animation-ending", UsageError):
        picture_file("a.gif")


def test_a_run_without_truth_or_without_estimate_is_animated(run):
    assert "@keyframes v" in animation(scene(replace(run, truth=None)))
    assert "@keyframes v" in animation(scene(replace(run, estimate=None)))


def test_a_truth_without_heading_is_drawn_on_the_map_and_the_estimate_is_animated(run):
    eta = run.truth.eta * [1.0, 1.0, np.nan]
    gps_run = replace(run, truth=run.truth._replace(eta=eta))
    sparse_truth = TruthLog(*(column[41::100] for column in run.truth))
    assert scene(gps_run).true_poses is scene(replace(run, truth=sparse_truth)).true_poses is None
    np.testing.assert_array_equal(scene(gps_run).vehicle_poses, scene(run).estimated_poses)
    longest_lines = [
        max(
            len(line.get_xdata())
            for line in paths(x)[0].figure.axes[0].get_lines()
            if line.get_label() == "truth"
        )
        for x in (gps_run, run)
    ]
    assert longest_lines[0] == longest_lines[1] > 100


def test_a_run_that_was_cut_before_the_first_pose_of_its_camera_has_a_report(run):
    cut_run = replace(run, truth=TruthLog(*(column[:0] for column in run.truth)))
    assert run_page(cut_run).title
    assert run_page(run.cut(0.0, 0.001)).title  # one tick
    with pytest.raises(AnswerNo):
        scene(run.cut(0.0, 0.001))


def test_the_report_writes_the_animation_beside_the_page(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(run, tmp_path / "lap.mcap")
    result = CliRunner().invoke(baqueano, ["report", "lap.mcap", "--animation", "lap.svg"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "lap.svg").read_text(encoding="utf-8").startswith("<svg")
    assert {path.name for path in tmp_path.iterdir()} >= {"lap.svg", "lap.html"}
    second = CliRunner().invoke(
        baqueano, ["report", "lap.mcap", "--animation", "lap.gif"], standalone_mode=False
    )
    assert isinstance(second.exception, UsageError)
