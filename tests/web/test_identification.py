"""The identification of a running drive: predicted from the guess, then from a real fit, each second, in its own
worker.
"""

import asyncio
import json
import os
import sys
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.design.information import DriveInformation
from baqueano.diagnostics import fault
from baqueano.identify import excitation
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import free_parameter
from baqueano.parameter import parameter
from baqueano.runs import write_run
from baqueano.simulate import simulate
from baqueano.vehicle_file import load
from baqueano.vehicles import AccelerationModel
from baqueano.web.lab import identification as module, live_identification
from baqueano.web.lab.drives import DriveIdentifications
from baqueano.web.lab.identification import DriveIdentification, parameter_label
from baqueano.web.lab.live_identification import LiveIdentification
from baqueano.web.lab.recorded import pack_run
from tests.web.fake_vehicle import live_page, until
from tests.web.page_client import browser, recorded_page

SECONDS = 14.0
GUESS = {
    "model.friction.linear": [5.0, 30.0, 0.02],
    "model.actuator_matrix": np.diag([2.0, 0.0, 0.12]).tolist(),
}


@pytest.fixture(scope="module")
def driven_runs():
    """Return a guess of `small`, and a run of the true vehicle."""
    small = load("small")
    u = excitation("random_steps", small.command.limit, SECONDS, small.rate_hz, seed=2, rest_s=1.0)
    return small.with_values(GUESS), small, simulate(small, u, seed=1)


def rows_of(run):
    record = pack_run(run)
    return [column["name"] for column in record.fields], record.columns.tolist()


def fitted(drive, seconds=60.0):
    """Repeat the request until a fit is available."""
    end = time.monotonic() + seconds
    while (state := drive.state())["fit"] is None:
        assert time.monotonic() < end, "no fit was received"
        time.sleep(0.05)
    return state


def test_before_8_s_the_page_shows_errors_predicted_from_the_guess(driven_runs):
    guess, _, run = driven_runs
    names, rows = rows_of(run)
    drive = DriveIdentification(guess)
    drive.add_rows(names, rows[:700])
    while (state := drive.state())["busy"]:
        pass
    assert state["fit"] is None
    drive_information = DriveInformation(guess)
    expected = drive_information.relative_std(drive_information.information(run.applied_commands[:700]))
    np.testing.assert_allclose(state["std"], expected, rtol=1e-3)
    assert state["bits"] == pytest.approx(-np.sum(np.log2(expected)), rel=1e-6)
    assert np.sum(state["rate"]) * state["dt"] == pytest.approx(state["bits"], rel=0.02)
    assert np.all(np.array(state["former_std"]) >= state["std"])
    drive.close()


def test_a_fit_replaces_predicted_errors_with_values_near_the_truth(driven_runs):
    guess, small, run = driven_runs
    names, rows = rows_of(run)
    drive = DriveIdentification(guess)
    for start in range(0, len(rows), 100):
        drive.add_rows(names, rows[start : start + 100])
        drive.state()
    state = fitted(drive)
    assert state["fit"]["verdict"] in ("USABLE", "WARN")
    k = [parameter["path"] for parameter in state["parameters"]].index("actuator_matrix[0,0]")
    value, std = state["fit"]["value"][k], state["fit"]["std"][k]
    truth = float(small.value("model.actuator_matrix[0,0]"))
    assert abs(value - 2.0) > 0.3  # different from the guess
    assert abs(value - truth) < 5.0 * std * truth
    assert state["next"]["to"] < state["next"]["from"]
    drive.close()


def test_the_next_fit_waits_longer_after_a_slow_fit(driven_runs, monkeypatch):
    guess, _, run = driven_runs
    start_s, fit_of = [], module.identify

    def slow(*arguments):
        start_s.append(time.monotonic())
        time.sleep(0.6)
        return fit_of(*arguments)

    names, rows = rows_of(run)
    drive = DriveIdentification(guess)
    monkeypatch.setattr(module, "PERIOD_S", 0.05)
    monkeypatch.setattr(module, "identify", slow)
    drive.add_rows(names, rows[:900])
    for start in range(900, len(rows)):
        drive.add_rows(names, rows[start : start + 1])
        drive.state()
        time.sleep(0.08)
        if len(start_s) == 3:
            break
    assert len(start_s) == 3
    assert min(np.diff(start_s)) > 1.15  # a fit, and as long again; without the rule 0.65
    drive.close()


@pytest.mark.parametrize(("backend", "period_s"), [("auto", 1.0), ("python", 15.0)])
def test_after_8_s_a_fit_begins_each_second_or_without_a_compiler_each_15_s(
    driven_runs, monkeypatch, backend, period_s
):
    guess, _, _ = driven_runs
    drive, fitted_s, clock = DriveIdentification(guess, backend), [], SimpleNamespace(now_s=100.0)
    assert drive.compiled == (period_s == 1.0)

    def fit(run):
        fitted_s.append((clock.now_s - 100.0, len(run.t_ns) / guess.rate_hz))
        return fault("fit.explains-nothing")

    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    monkeypatch.setattr(drive, "_fit", fit)
    monkeypatch.setattr(drive, "_advance", lambda until_s: None)  # the information is not part of this test
    names = ["t", "u.0", "u.1", "u.2", "z.imu[0]", "z.imu[1]", "z.imu[2]"]
    for k in range(160):  # 40 s in quarters, the drive and the clock at the same pace
        clock.now_s += 0.25
        drive.add_rows(names, [[0.01 * (25 * k + j), *[0.1] * 6] for j in range(25)])
        assert drive.state()["compiled"] == drive.compiled
        if drive._job is not None:
            drive._job.result()
    drive.close()
    expected = np.arange(8.0, 40.01, period_s)
    np.testing.assert_allclose([began_s for began_s, _ in fitted_s], expected)
    np.testing.assert_allclose([data_s for _, data_s in fitted_s], expected)  # each time all data


class Viewer:
    language = "en"

    def __init__(self):
        self.words = []

    def send(self, word):
        self.words.append(word)


async def test_the_rows_of_a_drive_are_sent_to_the_worker_each_second(monkeypatch):
    messages_sent, waits, visitor = [], [], Viewer()
    identifying = LiveIdentification(lambda: [visitor])

    async def request(do, **words):
        messages_sent.append(len(words["rows"]))
        return {"busy": False}, b""

    async def wait(seconds):
        waits.append(seconds)
        identifying.add_rows([[0.01 * len(waits), 0.0]])
        if len(waits) == 5:
            identifying.set_subscription(visitor, False)

    monkeypatch.setattr(identifying._lab, "request", request)
    patches = {name: getattr(asyncio, name) for name in ("create_task", "CancelledError")}
    monkeypatch.setattr(live_identification, "asyncio", SimpleNamespace(**patches, sleep=wait))
    identifying.vehicle = "small"
    identifying.begin(["t", "u.0"])
    identifying.add_rows([[0.0, 0.0]])
    identifying.set_subscription(visitor, True)
    await identifying._request_task
    assert waits == [1.0] * 5
    assert messages_sent == [1] * 5
    assert [word["busy"] for word in visitor.words] == [True, *[False] * 5]  # before the first answer
    await identifying.close()


def test_missing_ticks_are_simulated_without_measurements(driven_runs):
    guess, _, run = driven_runs
    names, rows = rows_of(run)
    full_drive, gap = DriveIdentification(guess), DriveIdentification(guess)
    full_drive.add_rows(names, rows[:300])
    gap.add_rows(names, rows[:100])
    gap.add_rows(names, rows[140:300])
    assert gap.duration_s == full_drive.duration_s == 3.0
    for drive in (full_drive, gap):
        while drive.state()["busy"]:
            pass
        drive.close()
    assert gap.state()["bits"] < full_drive.state()["bits"]
    gap.add_rows(names, rows[1000:1100])  # seven seconds later it is another segment
    assert gap.duration_s == 1.0
    gap.add_rows(names, rows[1000:1050])  # earlier data are not used twice
    assert gap.duration_s == 1.0


def test_every_parameter_of_the_garage_has_a_readable_label():
    for name in ("small", "car", "case-study-1"):
        drive = DriveIdentification(load(name), "numpy")
        labels = [parameter_label(parameter) for parameter in drive._free]
        drive.close()
        assert labels
        assert len(set(map(str, labels))) == len(labels)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sledge(AccelerationModel):
    pull: float = parameter("m/s² per unit of u", "pull of a command", default=1.0, role="gain", label="rope")
    glide: float = parameter("1/s", "drag on snow", default=2.0)


def test_a_user_parameter_is_labelled_by_its_metadata():
    blocks = FittedBlocks(Sledge(), load("small").sensors)
    names = {key: parameter_label(free_parameter(blocks, f"model.{key}", {})) for key in ("pull", "glide")}
    assert {key: note.figures["meaning"] for key, note in names.items()} == {
        "pull": "rope",
        "glide": "drag on snow",
    }


async def test_a_page_shows_identification_while_answering_other_requests(tmp_path, driven_runs):
    guess, _, run = driven_runs
    names, rows = rows_of(run)
    path = tmp_path / "guess.toml"
    path.write_text(guess.text, encoding="utf-8")
    async with live_page(tmp_path) as (server, link, live):
        live.identifying.vehicle = str(path)
        link.on_word({"type": "fields", "names": names, "units": ["1"] * len(names)})
        for start in range(0, 1000, 100):
            link.on_word(
                {
                    "type": "frame",
                    "x": json.loads(json.dumps(rows[start : start + 100]).replace("NaN", "null")),
                }
            )
        async with browser(server, "es") as visitor, browser(server) as second:
            await visitor.send("identify", on=True)
            assert (await visitor.next("identify"))["parameters"] == []
            first = await visitor.next("identify", where=lambda word: word["parameters"])
            assert first["parameters"][0]["label"] == "resistencia al avanzar"
            answer = await visitor.next("identify", where=lambda word: word["fit"] is not None)
            assert answer["t"] == 10.0
            assert answer["fit"]["verdict"]
            assert "4 s" in answer["next"]["motion"]
            await second.send("ask", id=7, question="ping")
            # a browser on another screen receives nothing
            assert (await second.next("answer", "identify"))["type"] == "answer"
            await visitor.send("identify", on=False)
            await until(lambda: not live.identifying._viewers)
            link.on_word({"type": "frame", "x": [[None] * len(names)]})


async def test_identification_of_a_finished_run_is_shown_at_all_times(tmp_path, driven_runs):
    _, _, run = driven_runs
    folder = tmp_path / "runs"
    folder.mkdir()
    write_run(run, folder / "taught.mcap")
    async with recorded_page(folder, "taught") as server, browser(server) as visitor:
        await visitor.send("ask", id=1, question="identify", run=visitor.hello["open"]["run"])
        answer = await visitor.next("answer", to="ask")
        errors = np.array(answer["expected"])
        assert np.all(np.diff(errors, axis=0) <= 1e-9)
        assert len(errors) * answer["step_s"] == pytest.approx(SECONDS, abs=0.3)
        assert [dated_fit["t"] for dated_fit in answer["fits"]] == sorted(
            dated_fit["t"] for dated_fit in answer["fits"]
        )
        assert answer["fits"][-1]["t"] == pytest.approx(SECONDS, abs=0.05)
        await visitor.send("ask", id=2, question="identify", run="none")
        assert (await visitor.next("refused"))["code"] == "web.no-run"


def test_a_drive_that_cannot_be_fitted_reports_its_reason(tmp_path):
    guess = load("small")
    drive = DriveIdentification(guess)
    names = ["t", "u.0", "u.1", "u.2", "z.imu[0]", "z.imu[1]", "z.imu[2]"]
    drive.add_rows(names, [[0.01 * k, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] for k in range(900)])
    end = time.monotonic() + 20.0
    while not (state := drive.state())["reason"] and state["fit"] is None and time.monotonic() < end:
        time.sleep(0.05)
    assert state["reason"]
    assert state["fit"] is None
    assert state["parameters"][0]["needs"]
    drive.close()


async def test_the_page_process_does_not_import_numpy():
    program = await asyncio.create_subprocess_exec(
        sys.executable, "-c",
        "import sys, baqueano.web.run, baqueano.web.lab.live_identification; sys.exit('numpy' in sys.modules)",
    )  # fmt: skip
    assert await program.wait() == 0


def test_a_vehicle_at_rest_is_not_fitted_repeatedly(driven_runs, monkeypatch):
    guess, _, run = driven_runs
    names, rows = rows_of(run)
    drive = DriveIdentification(guess)
    monkeypatch.setattr(module, "PERIOD_S", 0.0)
    drive.add_rows(names, rows[:900])
    fitted(drive)
    while drive.state()["busy"]:
        time.sleep(0.02)
    took = [state["fit"]["took_s"] for state in (drive.state(), drive.state())]
    time.sleep(0.1)
    assert not drive.state()["busy"]
    assert drive.state()["fit"]["took_s"] == took[0] == took[1]
    drive.restart()
    assert drive.state()["fit"] is None
    drive.close()


def test_a_changed_vehicle_file_is_read_again_for_the_next_drive(tmp_path, driven_runs):
    guess, small, run = driven_runs
    names, rows = rows_of(run)
    path, drives = tmp_path / "own.toml", DriveIdentifications()
    path.write_text(guess.text, encoding="utf-8")

    def guess_after(drive: int) -> float:
        word = {"vehicle": str(path), "drive": drive, "names": names, "rows": rows[:20]}
        answer, _ = drives.answer(word)
        k = [parameter["path"] for parameter in answer["parameters"]].index("actuator_matrix[0,0]")
        return answer["parameters"][k]["guess"]

    assert guess_after(1) == 2.0
    path.write_text(small.text, encoding="utf-8")
    os.utime(path, ns=(1, 1))
    assert guess_after(1) == 2.0  # a drive continues with the file with which it began
    assert guess_after(2) == float(small.value("model.actuator_matrix[0,0]"))
