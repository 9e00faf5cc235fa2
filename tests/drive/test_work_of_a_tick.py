"""A tick on board takes little work; calls are counted, because times depend on the machine."""

import sys
from collections import Counter

import pytest

import baqueano as bq
from baqueano.drive.observers import Observer
from baqueano.guides.shapes import sinuous_circle
from baqueano.loop import Record

SETTLED_TICKS = 250  # the rest and the start of the route are over


class CallCounter(Observer):
    """An observer that counts the calls of Python and of C from one tick to the next."""

    def __init__(self) -> None:
        self.ticks = 0
        self.calls: Counter[str] = Counter()

    def on_record(self, record: Record) -> None:
        self.ticks += 1
        if self.ticks == SETTLED_TICKS:
            sys.setprofile(lambda frame, event, argument: self.calls.update((event,)))

    def end(self, reason: object) -> tuple[()]:
        sys.setprofile(None)
        return ()


@pytest.mark.parametrize(("event", "limit"), [("call", 180), ("c_call", 230)])
def test_a_tick_of_a_repetition_into_a_file_makes_few_calls(tmp_path, event, limit):
    counter = CallCounter()
    route = sinuous_circle(1.0, 0.2, 6, 0.1)
    bq.repeat(bq.load("small"), route, path=tmp_path / "run.mcap", duration_s=4.0, observers=[counter])
    per_tick = counter.calls[event] / (counter.ticks - SETTLED_TICKS)
    assert per_tick <= limit, per_tick
