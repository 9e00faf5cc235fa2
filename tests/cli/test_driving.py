"""`baqueano drive` as a separate process, on a pseudo terminal that this test controls."""

import contextlib
import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason, note
from baqueano.drive import teach
from baqueano.drive.closure import closure, lap_closure
from baqueano.drive.manual.terminal_heartbeat import MAX_FIRST_ANSWER_S, MAX_SILENCE_S
from baqueano.drive.session import drive_stop_reason, mark_times_ns
from baqueano.errors import AnswerNo
from baqueano.guides.shapes import circle, eight
from baqueano.messages import text
from baqueano.runs import read_run
from baqueano.runs.route_file import read_route
from baqueano.vehicle_file.provenance import Provenance
from tests.codes import refused
from tests.drive.test_closure import drive_of_turns
from tests.drive.test_lap_closure import NOISE

pty = pytest.importorskip("pty", reason="a terminal of Unix")

CHILD = (  # the slave becomes the controlling terminal, as with ssh
    "import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    "from baqueano.drive.manual import cockpit, terminal_heartbeat\n"
    "terminal_heartbeat.GONE_S = cockpit.MAX_FIRST_ANSWER_S = float(sys.argv.pop(1))\n"
    "from baqueano.cli import main; main(sys.argv[1:])"
)
DRIVE = ("drive", "--vehicle", "small", "-o", "run.mcap")
W_DOWN, W_UP = b"\x1b[119;1:1u", b"\x1b[119;1:3u"


class Terminal:
    """A terminal that answers like kitty while it is `present`. The drive ends after `gone_s` without an answer. This
    time is long, because a busy machine may delay the answers."""

    def __init__(self, folder, *words, kitty=True, present=True, gone_s=15.0):
        import termios

        self.present, self.kitty, self.output, self.over = present, kitty, b"", False
        self.master, self.slave = pty.openpty()
        self.before = termios.tcgetattr(self.slave)
        environment = {k: v for k, v in os.environ.items() if not k.startswith("SSH_")}
        self.process = subprocess.Popen(
            [sys.executable, "-c", CHILD, str(gone_s), *words], cwd=folder, stdin=self.slave, stdout=self.slave,
            stderr=self.slave, start_new_session=True, env=environment,
        )  # fmt: skip
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def until(self, pattern, within_s=40.0):
        """Wait until the screen has shown this pattern."""
        assert self.shows(pattern, within_s), self.output[-2000:].decode(errors="replace")

    def shows(self, pattern, within_s):
        """Return True if the screen shows this pattern within the time."""
        end = time.monotonic() + within_s
        while not re.search(pattern, self.output):
            if time.monotonic() > end or not (self.over or self.process.poll() is None):
                return False
            time.sleep(0.05)
        return True

    def type(self, keys):
        os.write(self.master, keys)

    def drive_ahead(self):
        """Press the key for ahead until the vehicle moves."""
        self.until(rb"terminal \d+ ms")
        self.type(W_DOWN)
        self.until(rb"speed +0\.[1-9]")

    def ends(self, within_s=40.0):
        """Wait for the end of the process and return its exit code."""
        code, self.over = self.process.wait(within_s), True
        return code

    def hang_up(self):
        self.present = False
        os.close(self.slave)
        master, self.master, self.slave = self.master, -1, -1
        self._thread.join()  # otherwise it reads from the next file with this number
        os.close(master)

    def close(self):
        self.process.kill()
        self.process.wait()
        if self.master >= 0:
            self.hang_up()

    def _live(self):
        import select

        while (master := self.master) >= 0:
            if not select.select([master], [], [], 0.02)[0]:
                continue
            try:
                data = os.read(master, 4096)
            except OSError:  # the other side is closed
                return
            self.output += data
            if self.present:
                answers = b"\x1b[?0u" * (self.kitty and b"\x1b[?u" in data) + b"\x1b[0n" * data.count(
                    b"\x1b[5n"
                )
                with contextlib.suppress(OSError):
                    os.write(master, answers)


@pytest.fixture
def terminal(tmp_path, until_end):
    return lambda *words, **options: until_end(Terminal(tmp_path, *words, **options))


def moving(run):
    """Return the times at which the motors ran [s]."""
    return run.t_s[np.abs(run.applied_commands[:, 0]) > 0.0]


def test_a_drive_by_keys_writes_a_run_and_restores_the_terminal(terminal, tmp_path):
    import termios

    screen = terminal(*DRIVE)
    screen.until(rb"hold to drive")
    screen.drive_ahead()
    screen.type(W_UP + b"\x1b[109;1:1u")
    screen.until(rb"(?s)marks 1.*u_x +\S+ \+0\.00")
    screen.type(b"\x1b[113;1:1u")
    assert screen.ends() == 0
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.INTERRUPTED
    assert len(mark_times_ns(run)) == 1
    assert np.max(run.applied_commands[:, 0]) == pytest.approx(0.5)
    assert run.applied_commands[-1, 0] == 0.0
    assert termios.tcgetattr(screen.slave) == screen.before
    screen.until(rb"(?s)\x1b\[<u.*\x1b\[\?25h|\x1b\[\?25h.*\x1b\[<u")  # its last output may still arrive
    assert screen.output.count(b"\x1b[>11u") == screen.output.count(b"\x1b[<u") == 1
    assert screen.output.rindex(b"\x1b[?25h") > screen.output.rindex(b"\x1b[?25l")


def test_a_set_point_below_the_dead_zone_is_reported_on_screen(terminal):
    screen = terminal(*DRIVE, "--latched", kitty=False)
    screen.until(rb"terminal \d+ ms")
    screen.type(b"w")
    screen.until(rb"0\.05 is below the dead zone of 0\.27: nothing moves; that key again, or \+")
    screen.type(b"q")
    assert screen.ends() == 0


@pytest.mark.parametrize("is_latched", [False, True])
def test_a_terminal_that_stops_answering_stops_the_vehicle(terminal, tmp_path, is_latched):
    screen = terminal(
        *DRIVE, *(["--latched"] if is_latched else []), kitty=not is_latched, gone_s=MAX_SILENCE_S
    )
    screen.until(rb"terminal \d+ ms")
    screen.type(b"w" if is_latched else W_DOWN)
    screen.until(rb"(?s)(?:u_x +\S+ \+0\.(?:05|50) .*?){12}")
    screen.present = False
    assert screen.ends() == 5
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.TERMINAL_SILENT
    assert run.applied_commands[-1, 0] == 0.0  # when: tests/emulated/test_driving.py
    assert len(moving(run)) > 50
    assert b"\x1b[?25h" in screen.output


def test_rt12_a_closed_terminal_stops_the_vehicle_and_the_run_is_complete(terminal, tmp_path):
    screen = terminal(*DRIVE)
    screen.drive_ahead()
    screen.hang_up()
    screen.ends()
    run = read_run(tmp_path / "run.mcap")
    assert drive_stop_reason(run).code == StopReason.TERMINAL_CLOSED
    assert run.applied_commands[-1, 0] == 0.0
    assert len(moving(run)) > 0


def test_single_keys_drive_at_a_terminal_that_never_answers(terminal, tmp_path):
    screen = terminal(*DRIVE, present=False, gone_s=MAX_FIRST_ANSWER_S)
    screen.until(rb"does not confirm that it is active")
    for _ in range(20):  # a key counts for 0.75 s; a busy machine may show nothing
        screen.type(b"w")
        if screen.shows(rb"u_x +\S+ \+0\.15", 2.0):
            break
    screen.until(rb"(?s)u_x +\S+ \+0\.15.*u_x +\S+ \+0\.00")
    screen.type(b"q")
    assert screen.ends() == 0
    run = read_run(tmp_path / "run.mcap")  # duration of the motion: tests/emulated/test_driving.py
    assert run.metadata["kind"] == "drive"
    assert len(moving(run)) > 0
    assert np.max(run.applied_commands[:, 0]) == pytest.approx(0.15)
    assert run.applied_commands[-1, 0] == 0.0


def test_teaching_with_keys_writes_a_route(terminal, tmp_path):
    screen = terminal("teach", "lab", "--driver", "keys", *DRIVE[1:])
    screen.drive_ahead()
    screen.type(W_UP + b"\x1b[113u")
    assert screen.ends() == 0
    assert read_route(tmp_path / "routes" / "lab.csv").t_s[-1] > 0.0
    assert read_run(tmp_path / "run.mcap").notes == ()


def test_driving_without_a_terminal_is_refused_with_advice(baqueano):
    end = baqueano("drive", "--vehicle", "small")
    assert end.code == 2
    assert "ssh -t" in end.paragraph


def test_driving_the_emulated_vehicle_by_keys_is_refused(baqueano):
    end = baqueano("drive", "--vehicle", "small", "--robot", "emulated")
    assert end.code == 2
    assert end.reason.code == "cli.emulated-manual"


def test_the_scale_from_marks_is_reported_and_written_to_the_file(baqueano, monkeypatch):
    run = drive_of_turns(vehicle_file.load("small"), [4.0 * np.pi])
    monkeypatch.setattr("baqueano.cli.driving.drive.drive_manually", lambda *args, **options: run)
    end = baqueano("drive", "--vehicle", "small", "--json")
    assert "type: --set sensors.imu.gyro_scale=0.9" in end.err
    (row,) = end.reply["rows"]
    assert row["sensors.imu.gyro_scale"] == pytest.approx(0.97, abs=0.01)
    assert row["marks"] == 2
    assert not Path("vehicle.toml").exists()
    assert baqueano("drive", "--vehicle", "small", "--update").code == 0
    assert vehicle_file.load("vehicle.toml").sensors.imu.gyro_scale == row["sensors.imu.gyro_scale"]


def test_a_drive_without_marks_explains_the_purpose_of_marks(baqueano, monkeypatch):
    run = drive_of_turns(vehicle_file.load("small"), [4.0 * np.pi])
    monkeypatch.setattr(
        "baqueano.cli.driving.drive.drive_manually",
        lambda *args, **options: replace(run, events=run.events[-1:]),
    )
    assert text(note("cli.marks-too-few")) in baqueano("drive", "--vehicle", "small").err


def test_a_program_such_as_tmux_that_hides_the_terminal_is_named(monkeypatch, baqueano, capsys):
    monkeypatch.setenv("SSH_CONNECTION", "1.2.3.4 5 6.7.8.9 22")
    monkeypatch.setattr(
        "baqueano.drive.manual.tty._ancestor_programs", lambda: ["python3", "bash", "tmux: server", "systemd"]
    )
    end = baqueano("drive", "--vehicle", "small")
    assert text(note("cli.terminal-hidden", program="tmux")) in end.err
    assert end.code == 2


def test_heading_control_is_enabled_by_default_and_can_be_disabled(terminal, tmp_path):
    text = vehicle_file.override(vehicle_file.load("small"), ("model.drivetrain.gain=[1.1,0.9]",)).text
    (tmp_path / "unequal.toml").write_text(text, encoding="utf-8")
    for words, pattern in (((), rb"heading hold [+-]0\.0[1-9]"), (("--no-hold",), rb"heading not corrected")):
        out = f"run{len(words)}.mcap"
        screen = terminal(*DRIVE[:3], "--robot", "simulated:unequal.toml", "-o", out, *words)
        screen.drive_ahead()
        screen.until(pattern)
        screen.type(b"\x1b[113;1:1u")
        assert screen.ends() == 0
        assert np.any(read_run(tmp_path / out).requested_commands[:, 2]) == (not words)


def test_the_heading_option_is_refused_without_driving_by_keys(baqueano):
    end = baqueano("teach", "lab", "--driver", "circle", "--no-hold")
    assert end.code == 2
    assert (end.reason.code, end.reason.figures["driver"]) == ("cli.hand-options", "circle")


GYRO = 0.97


def save_identified_robot(folder):
    provenance = {"model.friction.linear": Provenance("0001-experiment", verdict="USABLE")}
    values = {f"estimator.{name}": value for name, value in NOISE.items()}
    return vehicle_file.load("small").with_values(values, provenance).save(folder / "vehicle.toml")


def test_a_taught_eight_writes_the_gyro_scale_into_the_vehicle_file(baqueano, tmp_path, monkeypatch):
    save_identified_robot(tmp_path)

    def drive_manually(verb, file, drive, path, **_options):
        true_file = file.with_values({"sensors.imu.gyro_scale": GYRO})  # this driver returns to the start
        return teach(true_file, eight(0.6, 0.4), seed=drive.seed, backend=drive.backend, path=path).run

    monkeypatch.setattr("baqueano.cli.driving.teach.drive_manually", drive_manually)
    end = baqueano("teach", "lab", "--driver", "keys", "--closed", "--update")
    assert end.code == 0
    assert "closed" in end.out
    imu = vehicle_file.load("vehicle.toml").sensors.imu
    assert imu.gyro_scale == pytest.approx(GYRO, abs=3.0 * GYRO * imu.gyro_scale_std)
    assert imu.gyro_scale_std < 0.004
    run = read_run(next((tmp_path / "runs").glob("*.mcap")))
    with refused("marks.too-few", AnswerNo):
        closure(run, vehicle_file.load("vehicle.toml"))
    with refused("marks.no-gyro", AnswerNo):
        lap_closure(replace(run, sensors={}), vehicle_file.load("vehicle.toml"))


def test_a_lap_that_stops_before_its_start_does_not_change_the_vehicle_file(baqueano, tmp_path, monkeypatch):
    path = save_identified_robot(tmp_path)
    text, refusals = path.read_bytes(), []
    lap = teach(vehicle_file.load(path), eight(0.4, 0.3), backend="python").run
    lap = lap.cut(0.0, lap.duration_s - 0.7)  # 20 cm

    def closure_of(*args):
        with refused("marks.lap-open", AnswerNo) as refusal:
            lap_closure(*args)
        refusals.append(refusal.value)
        raise refusal.value

    monkeypatch.setattr("baqueano.drive.closure.lap_closure", closure_of)
    monkeypatch.setattr("baqueano.cli.driving.teach.drive_manually", lambda *args, **options: lap)
    end = baqueano("teach", "lab", "--driver", "keys", "--closed", "--update")
    assert refusals[0].diagnostic.fix in end.err
    assert path.read_bytes() == text


def test_an_unidentified_vehicle_needs_marks_for_its_gyro_scale(baqueano, monkeypatch):
    def drive_manually(verb, file, drive, path, **_options):
        return teach(file, circle(0.3, 0.25), path=path).run

    monkeypatch.setattr("baqueano.cli.driving.teach.drive_manually", drive_manually)
    end = baqueano("teach", "lab", "--driver", "keys", "--closed", "--vehicle", "small")
    assert end.code == 0
    assert "press m" in end.err + end.out
