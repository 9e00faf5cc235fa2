"""A lap that a person taught on the page gives the gyro scale of the vehicle file, once; other runs do not."""

import time
from dataclasses import replace
from pathlib import Path

import pytest

from baqueano.drive import teach
from baqueano.errors import AnswerNo, FileError, UsageError
from baqueano.guides.shapes import eight
from baqueano.runs import write_run
from baqueano.runs.route_file import read_route, write_route
from baqueano.vehicle_file import load
from baqueano.vehicle_file.provenance import Provenance
from baqueano.web.guard import Role
from baqueano.web.lab.worker import Worker
from tests.codes import refused
from tests.drive.test_lap_closure import NOISE, TRUE
from tests.web.chromium import CHROMIUM, SIZES
from tests.web.fake_vehicle import live_page
from tests.web.page_client import browser
from tests.web.screens import BOXES, PAGE, REST_S, open_page, until
from tests.web.scripted import RUNS

FIT = {"model.friction.linear": Provenance("0001-experiment", verdict="USABLE")}


@pytest.fixture(scope="module")
def lesson():
    """A lap of a person who returns to the start, and its route."""
    file = load("small").with_values({f"estimator.{key}": x for key, x in NOISE.items()}, FIT)
    run, route = teach(
        file.with_values({"sensors.imu.gyro_scale": TRUE}), eight(0.4, 0.3), seed=3, backend="python"
    )
    return file, replace(run, reference=None), route


@pytest.fixture
def words(lesson, tmp_path):
    """The request to close a lap, for a vehicle file, a run and a route in a folder."""
    file, run, route = lesson
    file.save(tmp_path / "vehicle.toml")
    write_run(run, tmp_path / "0002-teach.mcap")
    write_route(route, tmp_path / "ring.csv")
    return {
        "type": "lap closure", "vehicle": str(tmp_path / "vehicle.toml"), "routes": str(tmp_path),
        "run": str(tmp_path / "0002-teach.mcap"), "route": "ring",
    }  # fmt: skip


def test_a_lap_changes_the_scale_and_its_route_once(words):
    path, ring = Path(words["vehicle"]), Path(words["routes"]) / "ring.csv"
    before = ring.read_bytes()
    reply, _ = Worker().answer(words)
    figures = reply["message"]["figures"]
    file = load(path)
    assert (figures["former_value"], figures["former_std"]) == (1.0, 0.0145)
    assert file.sensors.imu.gyro_scale == pytest.approx(figures["value"], abs=1e-4)
    assert abs(figures["value"] - TRUE) < 3.0 * figures["std"] < 0.02
    assert file.provenance["sensors.imu.gyro_scale"].run == "0002-teach"
    assert ring.read_bytes() != before
    assert read_route(ring).closed
    text = path.read_bytes()
    with refused("web.lap-used", AnswerNo):
        Worker().answer(words)
    assert path.read_bytes() == text


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda run: run.cut(0.0, 0.92 * run.duration_s), "marks.lap-open"),
        (lambda run: replace(run, metadata=run.metadata | {"kind": "repeat"}), "web.no-lesson"),
        (lambda run: replace(run, vehicle_text=load("case-study-1").text), "web.no-lesson"),
    ],
)
def test_a_run_that_is_not_a_closed_manual_lap_does_not_change_the_file(
    words, tmp_path, lesson, change, code
):
    path = write_run(change(lesson[1]), tmp_path / "0003-teach.mcap")
    text = Path(words["vehicle"]).read_bytes()
    with refused(code, AnswerNo):
        Worker().answer(words | {"run": str(path)})
    assert Path(words["vehicle"]).read_bytes() == text


def test_a_lap_that_followed_a_route_is_refused(words, tmp_path, lesson):
    run, _ = teach(lesson[0], eight(0.4, 0.3), seed=3, backend="python")
    path = write_run(run, tmp_path / "0003-teach.mcap")
    with refused("web.no-lesson", AnswerNo):
        Worker().answer(words | {"run": str(path)})


def test_a_vehicle_without_its_own_file_or_fit_is_refused(words, tmp_path):
    with refused("web.tune-garage", UsageError):
        Worker().answer(words | {"vehicle": "small"})
    load("small").save(tmp_path / "guess.toml")
    with refused("web.no-lesson", AnswerNo):
        Worker().answer(words | {"vehicle": str(tmp_path / "guess.toml")})
    with refused("door.route-name", FileError):
        Worker().answer(words | {"route": "../vehicle"})


async def test_the_driver_closes_a_lap_and_a_viewer_does_not(words, tmp_path):
    async with live_page(tmp_path, shared_address="127.0.0.2") as (server, _, _live):
        page, tokens = server._on_message.__self__, server.guard.tokens
        page.source = lambda: {"vehicle": words["vehicle"], "routes": words["routes"]}
        async with (
            browser(server, token=tokens[Role.DRIVE]) as driver,
            browser(server, token=tokens[Role.VIEW]) as viewer,
        ):
            (run,) = driver.hello["runs"]
            await viewer.send("write", lap=run["id"], route="ring")
            assert (await viewer.next("refused"))["code"] == "web.role"
            await driver.send("write", lap="unknown")
            assert (await driver.next("refused"))["code"] == "web.no-run"
            await driver.send("write", lap=run["id"], route="ring")
            assert words["vehicle"].rpartition("/")[2] in (await driver.next("event"))["text"]
    assert load(words["vehicle"]).provenance["sensors.imu.gyro_scale"].run == "0002-teach"


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
def test_the_page_offers_the_closure_after_a_manual_lap(tab, live):
    closed_flag = f"{PAGE}.screens.drive.closed"
    runs = [
        {"id": "r9", "name": "0009-teach", "kind": "teach", "seconds": 20.0, "when": None, "laps": None},
        *RUNS,
    ]
    open_page(tab, live)
    live.go("READY")
    tab.click("#lease")
    tab.wait(f"{PAGE}.ready && {closed_flag}.hidden")
    live.put({"type": "runs", "runs": runs})  # a lap of an earlier page
    tab.wait(f"{PAGE}.runs[0].id === 'r9'")
    assert tab.js(f"{closed_flag}.hidden")
    tab.press("t", code="KeyT")
    until(lambda: live.words("mission"))
    assert live.words("mission")[0]["name"] == "route-1"
    live.put({"type": "runs", "runs": runs})
    tab.wait(f"!{closed_flag}.hidden")
    live.go("MISSION", "teach")
    tab.wait(f"{closed_flag}.hidden")
    live.go("READY")
    live.put({"type": "runs", "runs": runs})
    tab.wait(f"!{closed_flag}.hidden && !{closed_flag}.disabled")
    assert tab.js(f"{closed_flag}.firstChild.textContent") == "Back at its start"
    tab.size(*SIZES["phone"])
    tab.js("dispatchEvent(new Event('resize'))")
    time.sleep(REST_S)
    assert not tab.js(BOXES)
    tab.press("c", code="KeyC")
    (word,) = until(lambda: live.words("write"))
    assert (word["lap"], word["route"]) == ("r9", "route-1")
    assert tab.js(f"{closed_flag}.hidden")
    live.put({"type": "runs", "runs": RUNS})
    live.put({"type": "runs", "runs": runs})
    tab.wait(f"{PAGE}.runs[0].id === 'r9' && {closed_flag}.hidden")
