"""A recorded run in a browser: the data, the language, and the memory of the page."""

import json
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest
from click.testing import CliRunner
from websockets.sync.client import connect

from baqueano.cli.page import options as page_options
from baqueano.cli.page.serve import command as serve
from baqueano.errors import UsageError
from baqueano.web import SUBPROTOCOL
from baqueano.web.lab.recorded import pack_run
from benchmarks.page import MOST_MB
from benchmarks.processes import resident_mb
from tests.web.page_client import WAIT_S, browser, drive, folder_of, recorded_page, request


@pytest.fixture
def folder(tmp_path):
    return folder_of(tmp_path / "runs", circle=drive(), short=drive("short", 40))


def columns_of(run):
    record = pack_run(run)
    return {field["name"]: record.columns[:, k] for k, field in enumerate(record.fields)}, record


def test_columns_of_a_run_contain_its_recorded_values():
    x, record = columns_of(drive())
    np.testing.assert_allclose(x["t"], 0.01 * np.arange(300), atol=1e-6)
    np.testing.assert_allclose(x["cross"], 0.01, atol=1e-6)
    np.testing.assert_allclose(x["progress"][-1], 2.99, rtol=1e-3)
    np.testing.assert_allclose(x["nis"], 1.0, rtol=1e-6)  # (0.1² / 0.01 + 0.2² / 0.04) / 2
    np.testing.assert_allclose(x["S.imu[2]"], 0.2, rtol=1e-6)
    np.testing.assert_allclose(x["model.imu[0]"], np.arange(300) - 0.1, rtol=1e-5, atol=1e-6)
    assert np.isnan(x["innov.imu[1]"]).all()
    assert np.isnan(x["truth.x"]).all()
    assert (x["u.0"][0], x["requested.0"][0], x["P.yy"][0]) == (0.5, np.float32(0.6), 9.0)
    assert record.description["vehicle"]["footprint"] == {"kind": "round", "length_m": 0.14, "width_m": 0.14}
    assert record.description["route"]["closed"] is False
    assert record.description["blocks"]["model"] == "planar"


@pytest.mark.parametrize(
    "text", ["", "name = 3", "command = 1\ngeometry = []", '[command]\nnames = "abc"\nlimit = "x"', "["]
)
def test_a_run_with_an_invalid_vehicle_file_is_shown(text):
    from dataclasses import replace

    _, record = columns_of(replace(drive(ticks=20), vehicle_text=text))
    assert record.columns.shape[0] == 20
    assert len(record.description["vehicle"]["command"]) == 3


def test_a_run_without_ticks_or_estimates_is_shown():
    from dataclasses import replace

    bare = replace(
        drive(ticks=5), estimate=None, reference=None, requested_commands=None, sensors={}, events=()
    )
    x, record = columns_of(bare)
    assert np.isnan(x["eta.x"]).all()
    assert record.description["route"] is None
    empty = replace(bare, t_ns=bare.t_ns[:0], applied_commands=bare.applied_commands[:0])
    assert pack_run(empty).frame(1, 0, 10)[4:8] == b"\0\0\0\0"


async def test_a_browser_receives_the_whole_run_and_its_ghost(folder):
    async with recorded_page(folder, "circle", "short") as server, browser(server) as visitor:
        assert (visitor.hello["mode"], visitor.hello["role"]) == ("replay", "drive")
        assert {run["name"] for run in visitor.hello["runs"]} == {"circle", "short"}
        await visitor.send("open", **visitor.hello["open"])
        first = await visitor.next("answer", where=lambda word: not word["done"])
        assert (first["stream"], first["run"]["kind"]) == (1, "repeat")
        assert first["events"][0]["text"] == "a stone"
        labels = {field["name"]: field["label"] for field in first["fields"]}
        assert labels["z.imu[2]"] == labels["innov.imu[2]"] == "yaw rate of the gyro"
        await visitor.next("answer", where=lambda word: word["stream"] == 2 and word["done"])
        columns = len(first["fields"])
        np.testing.assert_array_equal(visitor.rows(1, columns), pack_run(drive()).columns)
        assert visitor.rows(2, columns).shape == (40, columns)


async def test_long_runs_are_sent_in_frames_of_limited_size(tmp_path):
    long = folder_of(tmp_path / "runs", long=drive("long", 9000))
    async with recorded_page(long, "long") as server, browser(server) as visitor:
        await visitor.send("open", **visitor.hello["open"])
        end = await visitor.next("answer", done=True)
        assert end["seconds"] == pytest.approx(89.99)
        columns = len(visitor.hello["fields"])
        assert [len(frame) for frame in visitor.frames] == [16 + 4 * columns * n for n in (4096, 4096, 808)]
        np.testing.assert_allclose(visitor.rows(1, columns)[:, 0], 0.01 * np.arange(9000), atol=1e-5)


async def test_each_browser_shows_the_language_that_its_user_chose(folder):
    page = recorded_page(folder, "circle")
    async with page as server, browser(server, "es") as spanish, browser(server, "en") as two:
        labels = [{f["name"]: f["label"] for f in visitor.hello["fields"]}["t"] for visitor in (spanish, two)]
        assert labels == ["tiempo", "time"]
        for visitor in (spanish, two):
            await visitor.send("beat", n=1)
        answers = [await visitor.next("refused") for visitor in (spanish, two)]
        assert [no["code"] for no in answers] == ["web.no-vehicle"] * 2
        assert answers[0]["reason"] != answers[1]["reason"]


async def test_reports_and_runs_are_fetched_by_their_id(folder):
    async with recorded_page(folder, "circle") as server, browser(server) as visitor:
        word = next(run["id"] for run in visitor.hello["runs"] if run["name"] == "short")
        status, headers, body = await request(server, f"GET /run/{word} HTTP/1.1")
        assert (status, body) == (200, (folder / "short.mcap").read_bytes())
        assert headers["Content-Disposition"] == 'attachment; filename="short.mcap"'
        status, headers, body = await request(server, f"HEAD /run/{word} HTTP/1.1")
        assert (status, body) == (200, b"")
        assert int(headers["Content-Length"]) == (folder / "short.mcap").stat().st_size
        status, headers, body = await request(server, f"GET /report/{word} HTTP/1.1")
        assert status == 200
        assert b"short" in body
        assert "sandbox" in headers["Content-Security-Policy"]


async def test_the_list_of_runs_describes_each_run(folder):
    (folder / "broken.mcap").write_bytes(b"no run")
    async with recorded_page(folder, "circle") as server, browser(server) as visitor:
        run_by_name = {run["name"]: run for run in (await visitor.next("runs"))["runs"]}
        assert run_by_name["circle"]["seconds"] == pytest.approx(2.99)
        assert run_by_name["broken"]["kind"] == "?"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc")
@pytest.mark.parametrize("verb", ["view", "serve"])
def test_a_run_is_served_without_numpy_and_in_little_memory(folder, verb):
    program = subprocess.Popen(
        [sys.executable, "-m", "baqueano", verb, "circle", "--runs", str(folder), "--no-browser"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert program.stderr is not None
    try:
        line = program.stderr.readline()
        url = re.search(r"http://127\.0\.0\.1:\d+/", line)
        assert url, line
        with pytest.raises(urllib.error.HTTPError, match="404") as none:
            urllib.request.urlopen(url[0] + "run/none", timeout=WAIT_S)
        none.value.close()
        with connect(
            url[0].replace("http", "ws") + "ws", origin=url[0].rstrip("/"), subprotocols=[SUBPROTOCOL]
        ) as visitor:
            visitor.send(json.dumps({"type": "hello", "lang": "en"}))
            hello = json.loads(visitor.recv(WAIT_S))
        assert (hello["mode"], hello["open"]["ghost"]) == ("replay", None)
        names = {run["id"]: run["name"] for run in hello["runs"]}
        assert names[hello["open"]["run"]] == "circle"
        with open(f"/proc/{program.pid}/maps") as maps:
            assert "numpy" not in maps.read()
        assert resident_mb(program.pid) <= MOST_MB
    finally:
        program.send_signal(signal.SIGINT)
        assert program.wait(WAIT_S) == 0
        program.stderr.close()


@pytest.mark.parametrize("other", [("--vehicle", "small"), ("--robot", "pilot@rover")])
def test_serve_refuses_a_run_together_with_a_vehicle(folder, monkeypatch, other):
    monkeypatch.setattr(page_options, "run", lambda job: job.close())  # it would serve until a signal comes
    done = CliRunner().invoke(serve, ["circle", *other, "--runs", str(folder), "--no-browser"])
    assert isinstance(done.exception, UsageError)
    assert done.exception.diagnostic.code == "web.one-of"
    assert done.exception.diagnostic.figures["names"] == f"RUN, {other[0]}"


def test_view_reports_a_missing_run_by_name(folder):
    end = subprocess.run(
        [sys.executable, "-m", "baqueano", "view", "triangle", "--runs", str(folder)],
        capture_output=True, text=True, encoding="utf-8",
    )  # fmt: skip
    assert end.returncode == 3
    assert "triangle" in end.stderr
