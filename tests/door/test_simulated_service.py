"""The simulated service: it answers like a robot, without hardware, over pipes and over a socket."""

import json
import queue
import subprocess
import sys
import threading
import time
from itertools import islice

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.door import VERSION
from baqueano.door.simulated.missions import StoredRoutes, mission_plan
from baqueano.door.simulated.pace import MAX_PACE, PacedClock
from baqueano.drive.mission import Mission, pack
from baqueano.errors import BaqueanoError, FileError, UsageError
from baqueano.guides import shapes
from baqueano.runs import read_run
from baqueano.runs.route_file import read_route
from baqueano.vehicle_file import load
from tests.codes import refused

PATIENCE_S = 40.0  # timeout of the test


class Child:
    """The service as a child process of a page."""

    def __init__(self, folder, *words):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "baqueano.door.simulated", "small", "--pace", "20", *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=folder,
        )  # fmt: skip
        self.output = queue.Queue()
        threading.Thread(target=self._hear, daemon=True).start()

    def _hear(self):
        for line in self.process.stdout:
            self.output.put(json.loads(line))

    def send(self, **words):
        self.process.stdin.write(json.dumps(words).encode() + b"\n")
        self.process.stdin.flush()

    def until(self, condition, beat=None):
        """Return the messages up to and including this message."""
        end, messages = time.monotonic() + PATIENCE_S, []
        while not messages or not condition(messages[-1]):
            assert time.monotonic() < end
            if beat is not None:
                self.send(**beat)
            try:
                messages.append(self.output.get(timeout=0.05))
            except queue.Empty:
                continue
        return messages

    def drive(self, beat=None, **mission):
        self.send(type="mission", door=VERSION, id="one", **mission)
        messages = self.until(lambda m: m["type"] == "done", beat or {"type": "beat"})
        return messages[-1], messages

    def close(self):
        self.process.stdin.close()
        code = self.process.wait(PATIENCE_S)
        self.process.stdout.close()
        return code


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("class")


@pytest.fixture  # a new service for each test, because pace and pause persist
def child(folder):
    child = Child(folder)
    yield child
    assert child.close() == 0


def test_the_simulated_service_teaches_repeats_and_sends_each_tick(child, folder):
    child.send(type="watch", hz=20)
    names = child.until(lambda m: m["type"] == "fields")[-1]["names"]
    end, _ = child.drive(kind="teach", name="oval", shape="circle", size_m=0.4, speed_m_s=0.3)
    assert (end["code"], end["reason"], end["route"]) == (0, None, "oval")
    assert read_route(folder / "routes/oval.csv").closed
    child.send(type="routes")
    assert "oval" in [row["name"] for row in child.until(lambda m: m["type"] == "routes")[-1]["routes"]]
    end, messages = child.drive(kind="repeat", route="oval", laps=2)
    assert (end["code"], end["reason"]) == (0, None)
    run = read_run(folder / "runs" / end["run"])
    assert run.metadata["kind"] == "repeat"
    # earlier frames belong to the taught drive
    begin = next(k for k, m in enumerate(messages) if m["type"] == "fields")
    rows = [row for m in messages[begin:] if m["type"] == "frame" for row in m["x"]]
    x = {name: np.array([row[k] for row in rows], dtype=float) for k, name in enumerate(names)}
    assert len(x["t"]) > 0.8 * len(run.t_ns)  # unread frames were replaced
    index = np.searchsorted(run.t_ns, np.round(x["t"] * 1e9).astype(int) - 1000)
    np.testing.assert_allclose(x["eta.x"], run.estimate.eta[index, 0], atol=1e-6)
    np.testing.assert_allclose(x["truth.y"], run.truth.eta[index, 1], atol=1e-6)
    route = next(m for m in messages if m["type"] == "route" and m["x"])
    assert x["progress"][-1] == pytest.approx(2 * route["length_m"], rel=0.1)
    states = [m for m in messages if m["type"] == "state" and m["mission"] == "repeat"]
    assert states
    assert {m["laps"] for m in states} == {2}


def test_a_manual_drive_records_a_route(child, folder):
    child.send(type="pace", factor=4.0)
    turns = {"type": "hand", "u": [0.6, 0.0, 0.1]}
    child.send(type="mission", door=VERSION, id="one", kind="teach", name="by-hand", hold=False)
    child.until(lambda m: m["type"] == "state" and (m["t_s"] or 0.0) > 2.0, turns)
    child.send(type="mark")
    child.send(type="end")
    end = child.until(lambda m: m["type"] == "done", {"type": "beat"})[-1]
    child.send(type="pace", factor=20.0)
    assert (end["code"], end["route"]) == (0, "by-hand")
    assert read_run(folder / "runs" / end["run"]).applied_commands[:, 0].max() > 0.3


def test_silence_of_a_page_stops_the_vehicle_until_cleared(child):
    child.send(type="mission", door=VERSION, id="one", kind="drive", by="page")
    end = child.until(lambda m: m["type"] == "done")[-1]
    assert end["reason"]["code"] == StopReason.HOLDER_SILENT
    assert 300.0 < end["reason"]["figures"]["silent_ms"] < 10_000.0
    refusal, _ = child.drive(kind="drive")
    assert (refusal["run"], refusal["code"]) == (None, 5)
    assert refusal["reason"]["figures"]["advice"]["fix"] == "baqueano robot clear HOST"
    child.send(type="clear")
    child.until(lambda m: m["type"] == "state" and m["state"] == "READY")


def times_in(messages):
    """Return the time [s] of each row of the frames in these messages."""
    return [t_s for m in messages if m["type"] == "frame" for (t_s,) in m["x"]]


def new_times(child):
    """Return the times [s] of the ticks of a paused drive that have not been received yet."""
    times, silences = [], 0
    while silences < 2:
        time.sleep(0.1)  # of five frames
        child.send(type="ping")
        new = times_in(child.until(lambda m: m["type"] == "pong"))
        times, silences = times + new, 0 if new else silences + 1
    return times


def test_paused_time_advances_by_single_ticks_and_accepts_a_stop(child):
    child.send(type="watch", hz=50, fields=["t"])
    child.send(type="mission", door=VERSION, id="one", kind="experiment", seconds=60.0, attended=False)
    messages = child.until(lambda m: m["type"] == "state" and (m["t_s"] or 0.0) > 0.0)
    child.send(type="pause")
    messages += child.until(lambda m: m["type"] == "state" and m["paused"])
    assert messages[-1]["t_s"] > 0.0, "the state at once contains the time of the drive"
    t_s = (times_in(messages) + new_times(child))[-1]
    for ticks in (1, 1, 5, 1):
        child.send(type="go", ticks=ticks)
        times = new_times(child)
        assert times == pytest.approx([t_s + 0.01 * k for k in range(1, ticks + 1)], abs=1e-6)
        t_s = times[-1]
    child.send(type="stop", reason="the teacher stops it")
    end = child.until(lambda m: m["type"] == "done")[-1]
    assert end["reason"]["code"] == StopReason.STOPPED_BY
    child.send(type="go")
    child.send(type="clear")
    child.until(lambda m: m["type"] == "state" and m["state"] == "READY")


@pytest.mark.parametrize(
    ("mission", "code"),
    [
        ({"kind": "repeat", "route": "none"}, "door.no-route"),
        ({"kind": "repeat", "route": "../oval"}, "door.route-name"),
        ({"kind": "teach", "name": "a/b"}, "door.route-name"),
        ({"kind": "teach", "shape": "star"}, "shape.unknown"),
        ({"kind": "teach", "shape": "circle", "size_m": "big"}, "door.not-a-number"),
        ({"kind": "dance"}, "mission.kind"),
        ({}, "mission.damaged"),
    ],
)
def test_an_invalid_mission_is_refused(tmp_path, mission, code):
    with refused(code), mission_plan(json.dumps(mission), load("small"), StoredRoutes(tmp_path), 0):
        pass


def test_a_complete_mission_uses_the_vehicle_file_that_it_contains(tmp_path):
    mission = pack(Mission("repeat", route=shapes.circle(0.4, 0.25), laps=3), load("small"))
    with mission_plan(mission.to_json(), load("car"), StoredRoutes(tmp_path), 7) as plan:
        assert (plan.vehicle_file.name, plan.mission.laps, plan.seed) == ("small", 3, 7)


def test_a_route_with_an_invalid_name_is_not_listed(tmp_path):
    shape = shapes.circle(0.4, 0.25)
    from baqueano.runs.route_file import write_route

    write_route(shape, tmp_path / "lab.csv")
    (tmp_path / "broken.csv").write_text("t_s\n")
    routes = StoredRoutes(tmp_path)
    assert [row["name"] for row in routes.rows()] == ["lab"]
    with pytest.raises(FileError):
        routes.read("broken")


class Time:
    """A clock that advances during each sleep."""

    def __init__(self):
        self.now_s, self.slept = 0.0, []

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now_s += seconds


def test_the_pace_is_simulated_seconds_per_real_second():
    clock = Time()
    pace = PacedClock(4.0, lambda: clock.now_s, clock.sleep)
    ticks = pace.ticks(100.0, lambda: False)
    times = list(islice(ticks, 400))
    assert times == [round(k * 1e7) for k in range(1, 401)]
    assert clock.now_s == pytest.approx(1.0)
    pace.set_pace(0.5)
    list(islice(ticks, 100))
    assert clock.now_s == pytest.approx(3.0)


def test_a_slow_computer_slows_time_and_skips_no_tick():
    clock = Time()
    pace = PacedClock(50.0, lambda: clock.now_s, clock.sleep)
    times = []
    for t_ns in islice(pace.ticks(100.0, lambda: False), 200):
        times.append(t_ns)
        clock.now_s += 0.01  # five times longer than a tick may take
    assert times == [round(k * 1e7) for k in range(1, 201)]
    assert pace.late_ms < 150.0


def test_paused_time_stays_paused_until_the_drive_is_interrupted():
    clock, interrupts = Time(), []
    pace = PacedClock(1.0, lambda: clock.now_s, clock.sleep)
    pace.pause()
    pace.resume(ticks=3)
    ticks = pace.ticks(100.0, lambda: bool(interrupts) or clock.now_s > 5.0)
    assert list(islice(ticks, 3)) == [10_000_000, 20_000_000, 30_000_000]
    assert clock.now_s < 0.1
    assert next(ticks) == 40_000_000
    assert clock.now_s > 5.0


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), 2 * MAX_PACE])
def test_a_pace_that_is_not_a_number_is_refused(factor):
    with refused("door.pace"):
        PacedClock().set_pace(factor)


def test_an_unknown_vehicle_gives_an_error_of_one_paragraph(tmp_path):
    result = subprocess.run(
        [sys.executable, "-m", "baqueano.door.simulated", "what there is not"],
        capture_output=True, text=True, cwd=tmp_path, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert result.returncode == 3
    assert "Traceback" not in result.stderr
    assert issubclass(UsageError, BaqueanoError)


def truths(messages, names):
    """Return {time [s]: true x, y} of each row since the start of the last drive."""
    begin = max(k for k, m in enumerate(messages) if m["type"] == "fields")
    t, x, y = (names.index(n) for n in ("t", "truth.x", "truth.y"))
    return {row[t]: (row[x], row[y]) for m in messages[begin:] if m["type"] == "frame" for row in m["x"]}


def test_a_fault_acts_at_once_but_not_in_the_fault_free_simulation(child, folder):
    child.send(type="watch", hz=20)
    names = child.until(lambda m: m["type"] == "fields")[-1]["names"]
    child.send(type="mission", door=VERSION, id="one", kind="experiment", seconds=8.0, attended=False, seed=5)
    child.until(lambda m: m["type"] == "state" and (m["t_s"] or 0.0) > 1.0)
    child.send(type="shake", kind="tilt", x=0.03)
    child.send(type="shake", kind="push", y=0.4)
    child.send(type="shake", kind="cut", target="gps")
    refusal = child.until(lambda m: m["type"] == "refused")[-1]
    assert refusal["diagnostic"]["code"] == "shake.target"
    messages = child.until(
        lambda m: m["type"] == "ledger" and len(m["rows"]) == 2 and m["rows"][1]["detections"]
    )
    tilt, push = messages[-1]["rows"]
    assert (tilt["fault"]["kind"], push["message"]["code"]) == ("tilt", "shake.push")
    assert push["detections"][0]["detector"]["code"] in ("ledger.who-nis", "ledger.who-gate")
    child.send(type="shake", end=1)
    row = child.until(lambda m: m["type"] == "ledger" and m["rows"][0]["ended"])[-1]["rows"][0]
    assert row["until_s"] > row["t_s"]
    end = child.until(lambda m: m["type"] == "done")[-1]
    shaken_run = read_run(folder / "runs" / end["run"])
    child.send(type="again", from_s=8.0, without=[])  # with the same faults
    end = child.until(lambda m: m["type"] == "done")[-1]
    run_read = read_run(folder / "runs" / end["run"])
    assert len(run_read.t_ns) == len(shaken_run.t_ns)
    for column in (
        lambda run: run.truth.eta, lambda run: run.truth.nu, lambda run: run.applied_commands,
        lambda run: run.sensors["imu"].z, lambda run: run.estimate.eta, lambda run: run.estimate.cov,
    ):  # fmt: skip
        np.testing.assert_array_equal(column(run_read), column(shaken_run))  # bit for bit
    child.send(type="again", from_s=push["t_s"], without=[2])
    messages = child.until(lambda m: m["type"] == "done")
    assert (messages[-1]["id"], messages[-1]["code"]) == ("again", 0)
    twin = read_run(folder / "runs" / messages[-1]["run"])
    codes = [e.diagnostic.code for e in twin.events if e.source == "shake"]
    assert codes == ["shake.tilt"]
    first = int(np.searchsorted(shaken_run.t_ns, round(push["t_s"] * 1e9) + 1))
    np.testing.assert_array_equal(twin.truth.eta[:first], shaken_run.truth.eta[:first])
    assert np.any(twin.truth.eta[first:] != shaken_run.truth.eta[first : len(twin.truth.eta)])
    assert len(truths(messages, names)) > 0.5 * len(twin.t_ns)


def test_a_mission_with_faults_is_repeated_without_faults_on_request(child, folder):
    mission = {
        "kind": "experiment",
        "seconds": 30.0,
        "seed": 5,
        "shake": ["0.5 s: sag 80 %", "0.5 s: drift imu[2] 0.01"],
    }
    child.send(type="mission", door=VERSION, id="one", attended=False, **mission)
    ledger = child.until(lambda m: m["type"] == "ledger" and len(m["rows"]) == 2)[-1]
    assert ledger["rows"][1]["message"]["figures"]["unit"] == "rad/s"
    child.until(lambda m: m["type"] == "state" and (m["t_s"] or 0.0) > 1.0)
    child.send(type="again", from_s=0.4)
    first = child.until(lambda m: m["type"] == "done")[-1]
    assert first["id"] == "one"
    child.until(lambda m: m["type"] == "state" and (m["t_s"] or 0.0) > 1.0)
    child.send(type="stop", reason="enough")
    twin = read_run(folder / "runs" / child.until(lambda m: m["type"] == "done")[-1]["run"])
    shaken_run = read_run(folder / "runs" / first["run"])
    assert not [e for e in twin.events if e.source == "shake"]
    n = min(len(twin.t_ns), len(shaken_run.t_ns))
    np.testing.assert_array_equal(twin.truth.eta[:50], shaken_run.truth.eta[:50])
    assert np.any(twin.truth.eta[50:n] != shaken_run.truth.eta[50:n])
    child.send(type="clear")
    child.until(lambda m: m["type"] == "state" and m["state"] == "READY")


@pytest.mark.parametrize(
    ("word", "code"),
    [
        ({"type": "shake", "kind": "sag", "part": 0.5}, "shake.no-drive"),
        ({"type": "shake", "end": 1}, "shake.no-drive"),
        ({"type": "mission", "door": VERSION, "kind": "drive", "shake": ["dance"]}, "shake.syntax"),
        ({"type": "mission", "door": VERSION, "kind": "drive", "shake": "dance"}, "shake.too-many"),
    ],
)
def test_an_invalid_fault_is_refused(child, word, code):
    child.send(**word, id="bad")
    message = child.until(lambda m: m["type"] == "refused" or (m["type"] == "done" and m["id"] == "bad"))[-1]
    assert (message.get("diagnostic") or message["reason"])["code"] == code


def test_a_manual_drive_is_not_repeated_without_faults(child):
    child.send(type="mission", door=VERSION, id="one", kind="drive")
    child.until(
        lambda m: m["type"] == "state" and (m["t_s"] or 0.0) > 0.1, {"type": "hand", "u": [0.3, 0.0, 0.0]}
    )
    child.send(type="again")
    message = child.until(lambda m: m["type"] == "refused", {"type": "beat"})[-1]
    assert message["diagnostic"]["code"] == "shake.manual"
    child.send(type="end")
    child.until(lambda m: m["type"] == "done", {"type": "beat"})
