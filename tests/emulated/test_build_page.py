"""The commands of docs/build.md set up an Uno, and the page shows their output."""

import re
import shlex
from pathlib import Path

import pytest

from baqueano.cli import main
from baqueano.robot.uno import serial_port
from baqueano.robot.uno.frames import Driver, EncoderKind
from baqueano.robot.workshop import uno_checks
from tests.emulated.realtime import on_pty

PAGE = (Path(__file__).parents[2] / "docs/build.md").read_text(encoding="utf-8")


def shape(figure):
    """Return the output without its numbers."""
    return re.sub(r"[-+]?\d+(\.\d+)*", "0", figure)


def test_the_build_page_shows_the_doctor_output_of_an_uno(firmware):
    block = PAGE.partition("The output of step 5 for an Uno without faults")[2].split("```")[1]
    rows = [re.split(r"  +", line, maxsplit=2)[1:] for line in block.splitlines()[1:]]
    with on_pty(firmware) as live:
        checks = list(uno_checks.check_uno(live.path, 0.0, seconds=0.3))
    assert [name for name, _ in rows] == [check.name for check in checks]
    for (_, figure), check in zip(rows[1:], checks[1:], strict=True):  # the first has the name of the line
        assert shape(check.figure).startswith(shape(figure).removesuffix("…")), check.name


def test_the_commands_of_the_build_page_configure_bridge_and_encoders(
    firmware, monkeypatch, capsys, tmp_path
):
    section = PAGE.partition("### Which bridge, which encoders")[2]
    lines = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)[0].splitlines()
    assert len(lines) == 2
    monkeypatch.chdir(tmp_path)
    with on_pty(firmware) as live:
        monkeypatch.setattr(serial_port, "find_port", lambda port: live.path)
        for line in lines:
            with pytest.raises(SystemExit) as exit_info:
                main([*shlex.split(line, comments=True)[1:], *(["1"] if "--watch" in line else [])])
            assert exit_info.value.code == 0
        with serial_port.open_uno() as uno:
            settings = uno.settings()
    assert (settings.driver, settings.encoders) == (Driver.TB6612, EncoderKind.QUADRATURE)
    assert re.search(r"battery \d+\.\d\d V, counts left 0, right 0, marks 0", capsys.readouterr().err)
