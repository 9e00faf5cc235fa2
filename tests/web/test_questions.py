"""Requests that a worker answers: gains and their laps, blocks, comparisons, the same data through another filter."""

import asyncio
import json
import os
import sys
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from baqueano.drive import repeat
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from baqueano.runs import write_run
from baqueano.vehicle_file import load
from baqueano.web.lab.tuning import TuningWorker
from baqueano.web.lab.worker_client import WorkerClient
from tests.codes import refused
from tests.web.page_client import WAIT_S, browser, folder_of, recorded_page

EKF = '''from baqueano.estimators import AugmentedEkf


class MyEkf(AugmentedEkf):
    """Mine."""


class MyLaw:
    def init(self):
        return 0

    def step(self, state, reference, estimate):
        return state, estimate
'''


@pytest.fixture(scope="module")
def driven_folder():
    return repeat(load("small"), circle(0.3, 0.2))


@pytest.fixture
def folder(tmp_path, driven_folder, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_blocks.py").write_text(EKF)
    folder_of(tmp_path / "runs")
    write_run(driven_folder, tmp_path / "runs" / "round.mcap")
    return tmp_path / "runs"


def inodes_of(pid, *tables):
    """Return the inodes of the sockets in these tables of the system."""
    inodes = set()
    for table in tables:
        rows = [line.split() for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]]
        inodes |= {row[6] for row in rows if len(row) > 7} if table == "unix" else {row[9] for row in rows}
    return inodes


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc")
async def test_the_lab_worker_has_no_socket(folder):
    lab = WorkerClient()
    async with asyncio.timeout(WAIT_S):
        listener = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)  # of the page
        for do, words in (("runs", {"paths": []}), ("open", {"path": str(folder / "round.mcap")})):
            await lab.request(do, **words)
        pid = lab._program.pid
        links = [os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir()]
        own = {link[8:-1] for link in links if link.startswith("socket:")}
        assert not own & inodes_of(pid, "tcp", "tcp6", "udp", "udp6", "raw", "unix")  # a pipe is nameless
        listener.close()
        await lab.close()


async def test_a_block_named_by_an_opened_run_is_not_executed(tmp_path, driven_folder, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "theirs.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'w')\n{EKF}")
    text = driven_folder.vehicle_text.replace('kind = "pd_feedforward"', 'kind = "theirs.py:MyLaw"')
    assert "theirs.py" in text
    runs = folder_of(tmp_path / "runs", sent=replace(driven_folder, vehicle_text=text))
    async with recorded_page(runs, "sent") as server, browser(server) as visitor:
        await visitor.send("open", **visitor.hello["open"])
        await visitor.next("answer", done=True)
        run = visitor.hello["open"]["run"]
        for topic in ("block", "check"):
            answer = await visitor.request(topic, room="controller", run=run)
            assert answer["code"] == "vehicle.kind", topic
        assert (await visitor.request("tune", run=run))["code"] == "vehicle.kind"
        answer = await visitor.request("block", room="estimator", run=run)
        # the others are still shown
        assert (answer["kind"], answer["step_us"]) == ("augmented_ekf", None)
        await visitor.send("open", run=run, filter="ekf")
        assert "theirs.py" in (await visitor.next("refused"))["reason"]
    assert not (tmp_path / "executed").exists()


@asynccontextmanager
async def asking(folder, language="en"):
    """Serve the runs of a folder, and open the page."""
    async with recorded_page(folder, "round") as server, browser(server, language) as visitor:
        yield visitor


async def test_the_tuning_answer_describes_each_gain_and_the_figures_of_a_lap(folder):
    async with asking(folder) as visitor:
        about = await visitor.request("tune")
        assert [gain["name"] for gain in about["gains"]] == ["k_i", "k_x", "k_chi", "join_m"]
        assert about["gains"][1]["unit"] == "1/s"
        assert about["gains"][1]["meaning"]
        assert about["route"] == "run"
        answer = await visitor.request("route", route="run")
        assert answer["name"] == "run"
        assert {name: answer[name] for name in about["path"]} == about["path"]
        own = [gain["file"] for gain in about["gains"]]
        lap = await visitor.request("lap", gains=own, route="run")
        weak = await visitor.request("lap", gains=[0.0, 0.0, 0.2, 1.0], route="run")
        assert 0 < lap["rms"] < weak["rms"]
        assert len(lap["x"]) == len(lap["y"]) > 100


async def test_the_meanings_of_gains_and_parameters_are_in_the_language_of_the_browser(folder):
    async with asking(folder, "es") as visitor:
        about = await visitor.request("tune")
        assert about["gains"][1]["meaning"] == "velocidad por error longitudinal e_x"
        rows = (await visitor.request("block", room="controller"))["parameters"]
        assert "velocidad por error longitudinal e_x" in {row["meaning"] for row in rows}


async def test_the_cost_map_has_its_minimum_at_the_end_of_a_descent(folder):
    async with asking(folder) as visitor:
        about = await visitor.request("tune", route="circle")
        own, low, high = ([gain[key] for gain in about["gains"]] for key in ("file", "low", "high"))
        axes = {"a": "k_chi", "b": "join_m", "route": "circle"}
        land = await visitor.request("landscape", gains=own, side=6, **axes)
        assert len(land["costs"]) == 36
        down = await visitor.request("downhill", gains=own, price=0.1, route="circle")
        assert down["cost"] < down["start_cost"]
        assert down["places"][0] != down["places"][-1]
        min_cost = min(c[0] + 0.1 * c[1] for c in land["costs"] if c[0] is not None)
        assert down["cost"] < min_cost * 1.001
        assert all(a <= g <= b for a, g, b in zip(low, down["path"][-1], high, strict=True))


async def test_a_new_request_replaces_the_previous_one_and_a_stop_waits_for_none(folder):
    async with asking(folder) as visitor:
        own = [gain["file"] for gain in (await visitor.request("tune"))["gains"]]
        request = {"gains": own, "a": "k_x", "b": "k_chi", "route": "run"}
        await visitor.send("ask", id=100, question="landscape", side=24, **request)
        began = asyncio.get_running_loop().time()
        await visitor.request("ping")
        assert asyncio.get_running_loop().time() - began < 0.5
        await visitor.send("ask", id=101, question="landscape", side=3, **request)
        answers = {}
        while len(answers) < 2:
            word = await visitor.next("answer", where=lambda word: word.get("id") in (100, 101))
            answers[word["id"]] = word
        assert answers[100]["stale"]
        assert len(answers[101]["costs"]) == 9


async def test_invalid_gains_routes_and_blocks_are_refused(folder):
    async with asking(folder) as visitor:
        for word in ({"room": "controller", "kind": "lqr"}, {"gains": [1, 1, 1, 1]}):
            await visitor.send("swap" if "room" in word else "write", **word)
            assert (await visitor.next("refused"))["code"] == "web.no-vehicle"
        for gains in ([1.0], ["x", 1, 1, 1], [1e999, 1, 1, 1], None, {"a": 1}):
            answer = await visitor.request("lap", gains=gains, route="run")
            assert answer["code"] == "web.not-understood", gains
        for topic, route in product(("tune", "route"), ("../runs/round", "none", "/etc/passwd")):
            assert (await visitor.request(topic, route=route))["code"] == "door.no-route", (topic, route)
        for kind in ("os.py:system", "/tmp/x.py:X", "../x.py:X", "nothing"):
            for topic in ("block", "check"):
                answer = await visitor.request(topic, room="estimator", kind=kind)
                assert answer["code"] == "web.no-kind", (topic, kind)
            await visitor.send("open", run=visitor.hello["runs"][0]["id"], filter=kind)
            assert (await visitor.next("refused"))["code"] == "web.no-kind", kind


async def test_a_block_is_shown_with_source_parameters_cost_and_check(folder):
    async with asking(folder) as visitor:
        about = await visitor.request("block", room="controller")
        assert about["kind"] == about["of_file"] == "pd_feedforward"
        assert {"lqr", "stanley", "my_blocks.py:MyLaw"} <= set(about["kinds"])
        assert "class PdFeedforward" in about["text"].splitlines()[about["line"]]
        assert {"k_x", "join_m"} <= {parameter["name"] for parameter in about["parameters"]}
        assert 0 < about["step_us"] < about["tick_us"]
        assert (await visitor.request("check", room="controller"))["findings"] == []
        assert (await visitor.request("check", room="controller", kind="my_blocks.py:MyLaw"))["findings"]
        own_block = await visitor.request("block", room="estimator", kind="my_blocks.py:MyEkf")
        assert own_block["name"] == "MyEkf"
        for room in ("vehicle", "sensors", "supervisor", "guide"):
            assert (await visitor.request("block", room=room))["text"]


async def test_a_replay_through_another_filter_is_sent_as_a_second_stream(folder, driven_folder):
    async with asking(folder) as visitor:
        await visitor.send("open", run=visitor.hello["runs"][0]["id"], filter="my_blocks.py:MyEkf")
        heads = [await visitor.next("answer", done=False) for _ in range(2)]
        await visitor.next("answer", where=lambda word: word.get("done") and word["stream"] == 2)
        assert [head["filter"] for head in heads] == [None, "my_blocks.py:MyEkf"]
        names = [field["name"] for field in heads[0]["fields"]]
        rows = [visitor.rows(stream, len(names)) for stream in (1, 2)]
        assert rows[0].shape == rows[1].shape
        index = names.index("eta.x")
        assert (
            np.nanmax(np.abs(rows[0][:, index] - rows[1][:, index])) < 1e-6
        )  # the same filter by another name
        z = [k for k, name in enumerate(names) if name.startswith("z.")]
        assert np.array_equal(rows[0][:, z], rows[1][:, z], equal_nan=True)


async def test_runs_are_compared_and_the_smaller_error_is_marked(folder, driven_folder):
    truth = driven_folder.truth._replace(eta=driven_folder.truth.eta + np.array([0.5, 0.0, 0.0]))
    write_run(replace(driven_folder, truth=truth, name="off"), folder / "off.mcap")
    async with asking(folder) as visitor:
        words = {run["name"]: run["id"] for run in visitor.hello["runs"]}
        comparison = await visitor.request("compare", runs=[words["round"], words["off"]])
        assert comparison["names"] == ["round", "off"]
        rows = [row for section in comparison["sections"] for row in section["rows"]]
        assert [row["best"] for row in rows if row["label"].startswith("position (ATE)")] == [0]
        json.dumps(comparison, allow_nan=False)


def test_gains_are_written_to_a_user_file_but_not_to_the_garage(tmp_path):
    path = load("small").save(tmp_path / "vehicle.toml")
    bench = TuningWorker()
    word = {"route": "circle", "gains": [0.25, 1.5, 6.0, 0.2]}
    assert bench.write(word | {"vehicle": str(path)}) == {"file": "vehicle.toml"}
    file = load(path)
    assert file.value("controller.k_chi") == 6.0
    assert file.value("controller.join_m") == 0.2
    assert file.provenance["controller.k_x"].run == "tune, page"
    with refused("web.tune-garage", UsageError):
        bench.write(word | {"vehicle": "small"})
