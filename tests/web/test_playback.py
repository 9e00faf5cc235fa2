"""New runs are played at a pace to all viewers."""

import asyncio
import io
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.cli.page.playback import PlaybackPage, run_with_page
from baqueano.diagnostics import StopReason, note, stop
from baqueano.errors import UsageError
from baqueano.tune.tune_result import Gain
from baqueano.web import share
from baqueano.web.lab.playback import RunPlayer, read_entries
from baqueano.web.lab.recorded import pack_run
from baqueano.web.lab.worker_client import WorkerClient
from tests.web.page_client import drive, folder_of


async def play(playback, paths):
    """Return the messages of a playback."""
    words = []
    for path in [*paths, None]:
        playback.enqueue(path)
    await playback.receive(words.append)
    return words


async def test_all_ticks_of_a_run_are_shown_in_order(tmp_path):
    folder = folder_of(tmp_path / "runs", circle=drive())
    lab = WorkerClient()
    words = await play(
        RunPlayer(lab, 20.0), [folder / "circle.mcap", note("web.demo-done", verdict="USABLE")]
    )
    await lab.close()
    kinds = [word["type"] for word in words]
    assert kinds[1:4] == ["vehicle", "fields", "route"]
    rows = [row for word in words if word["type"] == "frame" for row in word["x"]]
    np.testing.assert_array_equal(np.array(rows, "f4"), pack_run(drive()).columns)
    assert {"MISSION", "READY"} == {word["state"] for word in words if word["type"] == "state"}
    assert words[-1]["message"].code == "web.demo-done"


async def test_playback_can_be_stopped_paused_and_paced(tmp_path):
    folder = folder_of(tmp_path / "runs", circle=drive())
    lab = WorkerClient()
    playback, words = RunPlayer(lab, 0.5), []
    playback.enqueue(folder / "circle.mcap")
    playback.enqueue(None)
    playing = asyncio.create_task(playback.receive(words.append))
    while not any(word["type"] == "frame" for word in words):
        await asyncio.sleep(0.01)
    playback.send("stop", reason=stop(StopReason.STOPPED_BY, words="eva"))
    await asyncio.sleep(0.2)
    frames = sum(word["type"] == "frame" for word in words)
    await asyncio.sleep(0.3)
    assert sum(word["type"] == "frame" for word in words) == frames
    assert [word["state"] for word in words if word["type"] == "state"][-1] == "STOPPED"
    playback.send("clear")
    playback.send("pace", factor=50.0)
    with pytest.raises(UsageError):
        playback.send("pace", factor=0.0)
    with pytest.raises(UsageError):
        playback.send("mission", kind="drive")
    await playing
    assert sum(len(word["x"]) for word in words if word["type"] == "frame") == 300
    await lab.close()


async def test_playback_waits_for_a_viewer_only_once(tmp_path, monkeypatch):
    from baqueano.web.lab import playback as module

    folder = folder_of(tmp_path / "runs", circle=drive())
    monkeypatch.setattr(module, "CONNECT_TIMEOUT_S", 0.2)
    lab = WorkerClient()
    playback = RunPlayer(lab, 1.0)
    playback.viewers = lambda: 0
    words = await play(playback, 2 * [folder / "circle.mcap"])
    assert not any(word["type"] == "frame" for word in words)
    assert sum(word["type"] == "vehicle" for word in words) == 2
    await lab.close()


def test_invalid_input_lines_of_the_playback_are_ignored():
    message = note("web.demo-done", verdict="USABLE")
    lines = [
        b"no\n",
        b"[]\n",
        b"{}\n",
        json.dumps({"play": "a.mcap"}).encode() + b"\n",
        json.dumps({"say": message.to_json()}).encode() + b"\n",
    ]
    messages = []
    read_entries(io.BytesIO(b"".join(lines)), messages.append)
    assert [str(messages[0]), *messages[1:]] == ["a.mcap", message, None]


def test_without_a_display_no_page_is_opened(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(share.sys, "platform", "linux")
    with run_with_page(tmp_path / "none", None, 4.0) as motion:
        assert motion._program is None
        motion.show(tmp_path / "a.mcap")
    assert not (tmp_path / "none").exists()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("CI", raising=False)
    assert share.has_display()
    with run_with_page(tmp_path / "none", False, 4.0) as motion:  # --no-page
        assert motion._program is None
    monkeypatch.setenv("CI", "1")
    assert not share.has_display()


def test_a_closed_page_does_not_end_the_work():
    class Gone:
        stdin = io.BytesIO()

    Gone.stdin.close()
    PlaybackPage(Gone()).show_event(note("web.demo-done", verdict="USABLE"))


async def test_a_playback_shows_the_vehicle_the_identification_and_the_gains(tmp_path, monkeypatch):
    from baqueano.web.lab import playback as module

    for name, seconds in (("FIT_PAUSE_S", 0.1), ("FIT_DISPLAY_S", 0.2), ("GAINS_DISPLAY_S", 0.2)):
        monkeypatch.setattr(module, name, seconds)
    taught_run = replace(drive(), metadata={"kind": "experiment"})
    folder = folder_of(tmp_path / "runs", experiment=taught_run, repeat=drive())
    gains = {"history": [3.0, 1.0], "start_cost": 3.0, "cost": 1.0, "gains": []}
    lab = WorkerClient()
    words = await play(RunPlayer(lab, 10.0), [folder / "experiment.mcap", gains, folder / "repeat.mcap"])
    await lab.close()
    scenes = [word["scene"] for word in words if word["type"] == "state"]
    distinct_scenes = [scene for k, scene in enumerate(scenes) if k == 0 or scene != scenes[k - 1]]
    assert [scene["screen"] for scene in distinct_scenes] == ["drive", "identify", "tuned", "drive"]
    assert distinct_scenes[2] == {"screen": "tuned"} | gains
    assert [word["file"] for word in words if word["type"] == "vehicle"] == [
        str(folder / "experiment.mcap"), str(folder / "repeat.mcap"),
    ]  # fmt: skip


def test_tuned_gains_are_sent_as_valid_json_numbers():
    pipe = io.BytesIO()
    pipe.flush = lambda: None

    class Program:
        stdin = pipe

    gain = Gain("k_x", "1/s", 2.5, math.nan, 0.0, 9.0, 0, 1.1, 1.2)
    tuning = SimpleNamespace(
        history=np.array([[0, 3.0], [0, 4.0], [1, 1.0]]), gains=(gain,), cost=1.0, cost_before=3.0
    )
    PlaybackPage(Program()).show_tuning(tuning)
    messages = []
    read_entries(io.BytesIO(pipe.getvalue()), messages.append)
    assert messages[0]["history"] == [3.0, 3.0, 1.0]  # the least so far
    assert messages[0]["gains"][0]["value"] == 2.5
    assert messages[1] is None
