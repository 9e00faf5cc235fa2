"""The lines of text that the driver reads in the terminal."""

import re

import numpy as np
import pytest

from baqueano.drive.manual.screen import Screen, Status, status_lines
from baqueano.messages.language import use_language


def terminal_screen(frames, rows=24):
    """The screen of a terminal after these bytes: it supports up, carriage return, new line and truncation."""
    screen, line = [""] * rows, 0
    for token in re.findall(r"\x1b\[\d+A|\x1b\[K|\x1b\[\?2026[hl]|[^\x1b\r\n]+|\r|\n", frames.decode()):
        if token.endswith("A") and token[0] == "\x1b":
            line -= int(token[2:-1])
        elif token == "\n":
            line += 1
        elif token[0] not in "\x1b\r":
            screen[line] = token
    return screen, line


@pytest.mark.parametrize("columns", [40, 80, 132])
def test_the_driver_display_fits_a_small_terminal_without_wrapping(columns):
    status = Status("pi@robot-of-a-long-name.local", reason="the battery " * 20, message="x" * 300)
    block = status_lines(status, columns)
    assert len(block) < 24
    assert max(map(len, block)) < columns
    assert all(line.isascii() for line in block)


@pytest.mark.parametrize("language", ["en", "es"])
@pytest.mark.parametrize("hold", [0.03, np.nan, None])
def test_the_heading_control_line_fits_into_eighty_columns(language, hold):
    with use_language(language):
        narrow, broad = (
            [row for row in status_lines(Status("robot", hold_command=hold), columns) if "u_psi" in row]
            for columns in (80, 160)
        )
    assert narrow == broad != []


def test_the_second_display_overwrites_the_first():
    screen, status = Screen(), Status("robot")
    first = screen.frame(status_lines(status))
    status.motor_command = np.array([0.3, 0.0, -1.0])
    screen_lines, line = terminal_screen(first + screen.frame(status_lines(status)))
    assert screen_lines[: len(status_lines(status))] == status_lines(status)
    assert line == len(status_lines(status))
    assert "+0.30" in "".join(screen_lines)


def test_a_terminal_with_few_lines_shows_the_last_lines_of_the_display():
    block = status_lines(Status("robot"))
    screen_lines, _ = terminal_screen(Screen().frame(block, height=5))
    assert screen_lines[:4] == block[-4:]


def test_an_unknown_value_is_displayed_as_a_dash():
    assert "battery - V" in "".join(status_lines(Status("robot")))
