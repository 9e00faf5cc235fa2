"""Real pyserial over a pty: writes are bounded, a disconnected line returns, and errors contain a remedy."""

import contextlib
import errno
import os
import threading
import time

import pytest

from baqueano.errors import RobotUnreachable, UsageError
from baqueano.robot.uno import serial_port
from baqueano.robot.uno.serial_port import SerialPort, find_port, open_uno, read_continuously, reset_uno_early
from tests.codes import refused

pty = pytest.importorskip("pty", reason="this system does not have pty")
termios = pytest.importorskip("termios", reason="this system does not have termios")
tty = pytest.importorskip("tty", reason="this system does not have tty")


@pytest.fixture
def ends():
    """Return (the end of the Uno, the path of the end of the host)."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    yield master, os.ttyname(slave)
    for fd in (master, slave):
        with contextlib.suppress(OSError):
            os.close(fd)


@pytest.mark.parametrize(
    ("number", "code"),
    [(errno.EACCES, "uno.port-not-allowed"), (errno.EAGAIN, "uno.port-in-use"), (errno.EBUSY, "uno.port-in-use"),
     (errno.ENOENT, "uno.port-not-opened")],
)  # fmt: skip
def test_the_message_about_an_unopened_line_depends_on_the_error_number(number, code):
    assert (
        serial_port._open_error("/dev/ttyUSB0", OSError(number, "in the language of the system")).code == code
    )


def test_bytes_pass_in_both_directions_and_reading_does_not_block(ends):
    master, path = ends
    port = SerialPort(path)
    port.open()
    assert port.read() == b""
    port.write(b"\0abc\0")
    assert os.read(master, 10) == b"\0abc\0"
    os.write(master, b"xyz")
    port.wait(1.0)
    assert port.read() == b"xyz"
    port.close()


def test_rt10_a_write_to_a_blocked_line_ends_soon(ends):
    _, path = ends
    port = SerialPort(path)
    port.open()
    refusal_times: list[float] = []
    while len(refusal_times) < 10:
        start_s = time.monotonic()
        try:
            port.write(bytes(100))
        except OSError:
            refusal_times.append(time.monotonic() - start_s)
    port.close()
    assert min(refusal_times) < 0.1  # WRITE_S is 0.01 s; the machine is not loaded in all of them


def test_rt10_a_disconnected_line_is_opened_again(ends, monkeypatch):
    monkeypatch.setattr(serial_port, "REOPEN_PERIOD_S", 0.01)
    _, path = ends
    port, stop, port_open = SerialPort(path), threading.Event(), threading.Event()

    class Link:
        def pump(self):
            with contextlib.suppress(OSError):
                port.read()

        def on_reopen(self):
            port_open.set()

    listener = threading.Thread(target=read_continuously, args=(port, Link(), stop))
    listener.start()
    assert port_open.wait(5.0)
    port_open.clear()
    port.close()
    assert port_open.wait(5.0)
    stop.set()
    listener.join()
    port.close()


def test_rt10_a_disconnection_while_the_line_is_opened_is_an_error_of_the_line(ends, monkeypatch):
    def flush(fd, queue):
        raise termios.error(errno.EIO, "Input/output error")

    monkeypatch.setattr(termios, "tcflush", flush)
    with refused("uno.port-not-opened", RobotUnreachable), open_uno(ends[1]):
        pass


def test_no_serial_line_and_several_lines_give_different_errors(monkeypatch):
    monkeypatch.setattr(serial_port.glob, "glob", lambda pattern: [])
    with refused("uno.no-line", RobotUnreachable):
        find_port("auto")
    monkeypatch.setattr(
        serial_port.glob, "glob", lambda pattern: ["/dev/serial/by-id/a", "/dev/serial/by-id/b"]
    )
    with refused("uno.several-lines", UsageError):
        find_port("auto")
    assert find_port("/dev/ttyACM3") == "/dev/ttyACM3"


def test_a_line_opened_before_the_service_is_closed_on_request(tmp_path):
    master, slave = pty.openpty()
    tty.setraw(slave)
    file = tmp_path / "vehicle.toml"
    file.write_text(f'[robot]\nport = "{os.ttyname(slave)}"\n')
    os.set_blocking(master, False)
    os.close(slave)
    give_back = reset_uno_early(file)
    with pytest.raises(BlockingIOError):  # another program has it open and sends nothing
        os.read(master, 10)
    give_back()
    with pytest.raises(OSError, match="Input/output error"):  # no program has it open
        os.read(master, 10)
    os.close(master)


@pytest.mark.parametrize(
    "text", [None, "[robot", 'robot = "Uno"', "[robot]\nport = 3", '[robot]\nport = "/dev/none"']
)
def test_opening_a_missing_line_early_raises_no_error(tmp_path, text):
    file = tmp_path / "vehicle.toml"
    if text is not None:
        file.write_text(text)
    reset_uno_early(file)()
