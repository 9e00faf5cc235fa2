"""Let Ctrl-C end a drive between two ticks, so that each record is complete; a second Ctrl-C ends it at once."""

import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interruptible_ticks(tick_times_ns: Iterable[int]) -> Iterator[Iterable[int]]:
    """Yield the same ticks. After Ctrl-C their iterator raises KeyboardInterrupt instead of the next tick.

    The effect of Ctrl-C is not changed if `is_default_handler` returns False.
    """
    is_interrupted = False

    def request_end(number: int, frame: FrameType | None) -> None:
        nonlocal is_interrupted
        is_interrupted = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def ticks() -> Iterator[int]:
        for t_ns in tick_times_ns:
            yield t_ns
            if is_interrupted:
                raise KeyboardInterrupt

    if not is_default_handler():
        yield tick_times_ns
        return
    previous_handler = signal.signal(signal.SIGINT, request_end)
    try:
        yield ticks()
    finally:
        signal.signal(signal.SIGINT, previous_handler)


def is_default_handler() -> bool:
    """Return True in the main thread of a program with Python's default handler of Ctrl-C."""
    main = threading.current_thread() is threading.main_thread()
    return main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
