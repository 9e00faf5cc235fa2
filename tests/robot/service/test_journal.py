"""The journal of a running mission, and the watchdog that is not fed after a thread has ended."""

import threading

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive.mission import Mission
from baqueano.robot.service import journal
from baqueano.robot.service.journal import Journal
from baqueano.robot.service.onboard import _watchdog_functions

MISSION = Mission(
    "experiment",
    u=np.zeros((1, 3)),
    vehicle='kind = "mine.py:Mine"\nkind = "gone.py:Other"',
    texts={"mine.py": ""},
)


@pytest.fixture
def boot(tmp_path, monkeypatch):
    """The file that identifies this start of the computer."""
    path = tmp_path / "boot_id"
    path.write_text("one\n")
    monkeypatch.setattr(journal, "BOOT_ID_FILE", path)
    return path


def test_an_unfinished_mission_is_named_with_its_blocks(boot, tmp_path):
    Journal(tmp_path).begin(MISSION, "1.mcap")
    unfinished_mission = Journal(tmp_path).unfinished_mission()
    assert unfinished_mission.code == StopReason.MISSION_UNFINISHED
    assert unfinished_mission.figures == {
        "kind": "experiment", "run": "1.mcap", "blocks": "mine.py:Mine", "file": "", "line": 0,
    }  # fmt: skip


def test_a_finished_mission_or_a_power_cut_is_not_named(boot, tmp_path):
    assert Journal(tmp_path).unfinished_mission() is None
    journal = Journal(tmp_path)
    journal.begin(MISSION, "1.mcap")
    journal.end()
    assert Journal(tmp_path).unfinished_mission() is None
    journal.begin(MISSION, "2.mcap")
    boot.write_text("another\n")
    assert Journal(tmp_path).unfinished_mission() is None


def test_a_damaged_journal_names_no_mission(boot, tmp_path):
    for content in (
        b"",
        b"one",
        b"one\nexperiment into 1.mcap\n",
        b"\x00" * 10_000,
        b"\xff\xfe\n",
        b"[]\n",
        b"7",
    ):
        Journal(tmp_path).path.write_bytes(content)
        assert Journal(tmp_path).unfinished_mission() is None


def test_an_unwritable_journal_does_not_block_a_drive(boot, tmp_path):
    journal = Journal(tmp_path / "there is no such folder")
    journal.begin(MISSION, "1.mcap")
    journal.end()
    assert journal.unfinished_mission() is None


def test_the_watchdog_is_not_fed_after_a_thread_ends():
    class Systemd:
        def __init__(self):
            self.messages = []

        def notify(self, text):
            self.messages.append(text)

    end, systemd = threading.Event(), Systemd()
    thread = threading.Thread(target=end.wait)
    thread.start()
    healthy, patience = _watchdog_functions(systemd)
    healthy()
    patience(2.0)
    assert systemd.messages == ["WATCHDOG=1", "WATCHDOG_USEC=2000000\nWATCHDOG=1"]
    end.set()
    thread.join()
    healthy()
    patience(2.0)
    assert len(systemd.messages) == 2
