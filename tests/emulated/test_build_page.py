"""docs/build.md: its lines of Python set up an Uno, and say what a builder wants to read."""

import re
from pathlib import Path

from baqueano.robot import serial_port
from baqueano.robot.frames import Driver, Encoders
from tests.emulated.realtime import on_pty

PAGE = (Path(__file__).parents[2] / "docs/build.md").read_text(encoding="utf-8")


def test_the_lines_of_the_page_set_the_bridge_and_the_encoders_and_tell_what_is_wired(
    firmware, monkeypatch, capsys
):
    lines = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]
    with on_pty(firmware) as live:
        monkeypatch.setattr(serial_port, "found", lambda port: live.path)
        exec(compile(lines, "docs/build.md", "exec"), {})
        with serial_port.connected() as uno:
            kept = uno.settings()
    assert (kept.driver, kept.encoders) == (Driver.TB6612, Encoders.QUADRATURE)
    said = capsys.readouterr().out
    assert re.search(r"battery \d+\.\d\d V, counts \(0, 0\), marks 0", said)
