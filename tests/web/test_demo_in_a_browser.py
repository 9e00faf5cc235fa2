"""`baqueano demo` opens a tab that shows the whole demo; a program of the test replaces the browser."""

import json
import os
import re
import subprocess
import sys
import time

import pytest
from websockets.sync.client import connect

from baqueano.cli.demo import command
from baqueano.diagnostics import note
from benchmarks.processes import before_others
from tests.web.test_serve import START_S

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="DISPLAY and BROWSER")
OPENS_S = 20.0
END_TIMEOUT_S = 600.0  # a demo on a busy machine
BROWSER = """
import json, sys, time
from pathlib import Path
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

address, out = sys.argv[2], Path(sys.argv[1])
seen = {
    "opened": time.monotonic(), "address": address, "screens": [], "frames": 0, "ended": "", "missions": [],
    "paces": [], "errors": [], "verdicts": [], "costs": [],
}
host = address.split("/")[2]
with connect(f"ws://{host}/ws", origin=f"http://{host}", subprotocols=["baqueano.3"], compression=None) as line:
    line.send(json.dumps({"type": "hello", "lang": "en"}))
    line.send(json.dumps({"type": "take"}))
    line.send(json.dumps({"type": "identify", "on": True}))
    try:
        for data in line:
            word = {"type": "frame"} if isinstance(data, bytes) else json.loads(data)
            seen["frames"] += word["type"] == "frame"
            screen = (word.get("scene") or {}).get("screen")
            if screen and seen["screens"][-1:] != [screen]:
                seen["screens"].append(screen)
                seen["costs"] += [word["scene"][name] for name in ("start_cost", "cost") if screen == "tuned"]
            mission = (word.get("mission") or {}).get("kind")
            if mission and seen["missions"][-1:] != [mission]:
                seen["missions"].append(mission)
            if word.get("pace") and seen["paces"][-1:] != [word["pace"]]:
                seen["paces"].append(word["pace"])
            if word["type"] == "identify" and word["parameters"]:
                seen["errors"].append(sorted(word["std"]))
                seen["verdicts"].append((word["fit"] or {}).get("verdict_id"))
    except ConnectionClosed as error:
        seen["ended"] = str(error)
out.write_text(json.dumps(seen))
"""


def demo(tmp_path):
    """Run the demo with a display and a browser; return its end, the received messages, and its start time."""
    script, log = tmp_path / "browser.py", tmp_path / "seen.json"
    script.write_text(BROWSER, encoding="utf-8")
    environment = {
        **os.environ, "DISPLAY": ":0",
        "BROWSER": f"{sys.executable} {script} {log} %s &",
    }  # fmt: skip
    environment.pop("CI", None)
    start_s = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "baqueano", "demo", "--pace", "50"], cwd=tmp_path, env=environment,
        timeout=END_TIMEOUT_S, capture_output=True, text=True,
    )  # fmt: skip
    end = time.monotonic() + START_S
    while not log.exists():
        assert time.monotonic() < end, done.stderr
        time.sleep(0.1)
    return done, json.loads(log.read_text()), start_s


def test_a_demo_opens_a_tab_within_20_s_shows_its_work_and_ends_by_itself(tmp_path):
    with before_others():
        done, record, start_s = demo(tmp_path)
    assert done.returncode == 0, done.stderr
    assert record["address"].startswith("http://127.0.0.1:")
    assert record["opened"] - start_s <= OPENS_S
    assert record["screens"] == ["drive", "identify", "tuned", "drive"], record
    assert record["frames"] > 20
    assert record["missions"] == ["experiment", "teach", "repeat"]
    assert record["paces"] == [50.0]
    before, after = record["costs"]
    assert after < before
    totals, fit = [sum(errors) for errors in record["errors"]], record["verdicts"].index("USABLE")
    first_fit = next(k for k, verdict in enumerate(record["verdicts"]) if verdict)
    assert totals[:first_fit] == sorted(totals[:first_fit], reverse=True)  # the bars shrink while it drives
    assert totals[fit] < 0.5 * totals[0]
    assert (tmp_path / "demo" / "report.html").exists()


def greeting(address):
    """Return the hello message of the page at an address."""
    host = address.split("/")[2]
    with connect(
        f"ws://{host}/ws", origin=f"http://{host}", subprotocols=["baqueano.3"], compression=None
    ) as line:
        line.send(json.dumps({"type": "hello", "lang": "en"}))
        return json.loads(line.recv(START_S))


def test_the_page_of_a_demo_is_served_before_the_first_kernel_is_compiled(tmp_path, monkeypatch, capfd):
    """The work of the demo, and so its first kernel, begins when the page already answers."""
    cache, greetings = tmp_path / "cache", []

    def begins(folder, seed, backend, progress, *show):
        progress(note("demo.experiment"))
        assert not list(cache.rglob("*"))
        address = re.search(r"http://127\.0\.0\.1:\d+/", capfd.readouterr().err)
        assert address, "no page is served"
        end = time.monotonic() + START_S
        while not greetings or (greetings[-1]["state"]["title"] != "PREPARING" and time.monotonic() < end):
            greetings.append(greeting(address[0]))
        raise SimulationCall

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setenv("CI", "1")  # no browser
    monkeypatch.setattr("baqueano.study.demo.demo", begins)
    with pytest.raises(SimulationCall):
        command.main(["--page"], standalone_mode=False)
    state = greetings[-1]["state"]
    assert (state["title"], state["severity"]) == ("PREPARING", "info")
    assert "experiment" in state["sentence"]


class SimulationCall(Exception):
    """Replaces the work of the demo, which is not done here."""


@pytest.mark.parametrize(("words", "opens_page"), [((), True), (("--page",), True), (("--no-page",), False)])
def test_a_demo_without_a_page_starts_no_page_process(tmp_path, monkeypatch, words, opens_page):
    commands, process = [], subprocess.Popen

    def starts(command, **options):
        commands.append(command)
        return process([sys.executable, "-c", ""], **options)

    def simulated(*words):
        raise SimulationCall

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setattr("baqueano.cli.page.playback.subprocess.Popen", starts)
    monkeypatch.setattr("baqueano.study.demo.demo", simulated)
    with pytest.raises(SimulationCall):
        command.main(list(words), standalone_mode=False)
    assert [call[2] for call in commands] == (["baqueano.web.lab.playback"] if opens_page else [])
    assert all(call[-2:] == ["--pace", "4.0"] for call in commands)
