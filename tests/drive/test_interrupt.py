"""Ctrl-C ends a drive between two ticks; a second Ctrl-C ends the drive at once."""

import signal
import threading
from contextlib import suppress

import pytest

from baqueano.drive.interrupt import interruptible_ticks, is_default_handler


@pytest.fixture(autouse=True)
def as_python_starts():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def ticks_done(presses: int, tick: int) -> list[int]:
    """Return the number of completed ticks of a drive with this number of Ctrl-C in tick `tick`."""
    ticks = []
    with suppress(KeyboardInterrupt), interruptible_ticks(range(10)) as tick_times_ns:
        for t_ns in tick_times_ns:
            for _ in range(presses if t_ns == tick else 0):
                signal.raise_signal(signal.SIGINT)
            ticks.append(t_ns)
    return ticks


def test_an_interrupt_lets_the_current_tick_finish():
    assert ticks_done(presses=1, tick=3) == [0, 1, 2, 3]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_ends_a_hanging_tick():
    assert ticks_done(presses=2, tick=3) == [0, 1, 2]


def test_without_an_interrupt_the_ticks_are_unchanged():
    with interruptible_ticks(range(10)) as tick_times_ns:
        assert list(tick_times_ns) == list(range(10))


def test_an_existing_interrupt_handler_is_not_replaced():
    handlers = []
    thread = threading.Thread(target=lambda: handlers.append(is_default_handler()))
    thread.start()
    thread.join()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assert [*handlers, is_default_handler()] == [False, False]
    with interruptible_ticks(range(3)) as tick_times_ns:
        assert list(tick_times_ns) == [0, 1, 2]
