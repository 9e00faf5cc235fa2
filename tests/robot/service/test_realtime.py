"""The priorities of the service's threads: the interpreter lock must not wait for ordinary programs."""

import os
import sys
import threading
from types import SimpleNamespace

import pytest

from baqueano.robot.service import realtime


@pytest.mark.skipif(sys.platform != "linux", reason="SCHED_FIFO")
def test_other_threads_get_the_priority_below_the_loop(monkeypatch):
    priorities, stop = {}, threading.Event()
    monkeypatch.setattr(
        os, "sched_setscheduler", lambda n, policy, p: priorities.update({n: p.sched_priority})
    )
    monkeypatch.setattr(
        realtime.ctypes, "CDLL", lambda *name, **options: SimpleNamespace(mlockall=lambda flags: 1)
    )
    monkeypatch.setattr(realtime.gc, "freeze", lambda: None)
    thread = threading.Thread(target=stop.wait)
    thread.start()
    try:
        realtime.request_realtime(40)
    finally:
        stop.set()
        thread.join()
    assert priorities[threading.get_native_id()] == 40
    assert priorities[thread.native_id] == 39
