"""docs/build.md: its lines set up an Uno, and tell what a builder wants to read."""

import re
import shlex
from pathlib import Path

import pytest

from baqueano.cli import main
from baqueano.robot import serial_port
from baqueano.robot.frames import Driver, Encoders
from tests.emulated.realtime import on_pty

PAGE = (Path(__file__).parents[2] / "docs/build.md").read_text(encoding="utf-8")


def test_the_lines_of_the_page_set_the_bridge_and_the_encoders_and_tell_what_is_wired(
    firmware, monkeypatch, capsys, tmp_path
):
    section = PAGE.partition("### Which bridge, which encoders")[2]
    lines = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)[0].splitlines()
    assert len(lines) == 2
    monkeypatch.chdir(tmp_path)
    with on_pty(firmware) as live:
        monkeypatch.setattr(serial_port, "found", lambda port: live.path)
        for line in lines:
            with pytest.raises(SystemExit) as ended:
                main([*shlex.split(line, comments=True)[1:], *(["1"] if "--watch" in line else [])])
            assert ended.value.code == 0
        with serial_port.connected() as uno:
            kept = uno.settings()
    assert (kept.driver, kept.encoders) == (Driver.TB6612, Encoders.QUADRATURE)
    assert re.search(r"battery \d+\.\d\d V, counts left 0, right 0, marks 0", capsys.readouterr().err)
