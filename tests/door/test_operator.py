"""The mailbox of the loop: only a processed request is removed."""

import signal
import sys

import pytest

from baqueano.diagnostics import StopReason, stop
from baqueano.door.operator import SILENCE_S, Operator
from baqueano.door.remote import HEARTBEAT_PERIOD_S
from baqueano.errors import SafetyStop
from tests.codes import refused

TEACHER = stop(StopReason.STOPPED_BY, words="the teacher stopped it")
SILENT = stop(StopReason.IMU_SILENT)
PATIENCE_S = 20.0  # timeout of the test


def test_clearing_one_stop_reason_does_not_clear_another():
    operator = Operator()
    operator.stop(TEACHER)
    operator.discard_requests(SILENT)
    assert operator.stop_reason(attended=False) == TEACHER
    operator.discard_requests(TEACHER)
    assert operator.stop_reason(attended=False) is None


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no alarm")
@pytest.mark.parametrize(
    ("word", "args"), [("discard_requests", (SILENT,)), ("stop", (TEACHER,)), ("set_holder", ("me",)),
    ("check_admission", ("me",))]
)  # fmt: skip
def test_a_signal_handler_does_not_wait_for_a_lock(word, args):
    operator, calls = Operator(), []

    def on_alarm(number, frame):
        operator.stop(stop(StopReason.SERVICE_ENDED))
        calls.append(number)

    def hung(number, frame):
        raise TimeoutError(f"{word} holds what the handler waits for")

    def ring(frame, event, arg):
        if frame.f_code is getattr(Operator, word).__code__ and event == "line":
            signal.raise_signal(signal.SIGTERM)
        return ring

    before = signal.signal(signal.SIGTERM, on_alarm), signal.signal(signal.SIGALRM, hung), sys.gettrace()
    signal.setitimer(signal.ITIMER_REAL, PATIENCE_S)
    sys.settrace(ring)
    try:
        getattr(operator, word)(*args)
    finally:
        sys.settrace(before[2])
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGALRM, before[1])
    assert len(calls) > 1
    assert operator.stop_reason(attended=False).code == StopReason.SERVICE_ENDED


def test_a_silence_of_0_3_s_of_any_driver_stops_the_vehicle():
    now_ns = 0
    operator = Operator(lambda: now_ns)
    operator.queue_mission("me", "a mission")
    operator.set_command("me", [0.5])
    now_ns = 299_000_000
    assert operator.stop_reason() is None
    assert operator.command(1) == 0.5
    now_ns = 301_000_000
    assert operator.stop_reason().code == StopReason.HOLDER_SILENT
    assert operator.command(1) == 0.0
    assert 5 * HEARTBEAT_PERIOD_S < SILENCE_S  # four lost heartbeats of a laptop do not stop it


def test_the_busy_message_distinguishes_a_drive_from_a_rest_between_drives():
    operator = Operator()
    operator.queue_mission("me", "a mission")
    with pytest.raises(SafetyStop) as error_info:
        operator.queue_mission("another", "a mission")
    about = error_info.value.diagnostic
    assert (about.code, about.fix) == ("door.other-driver", "baqueano robot stop HOST")
    operator.pop_mission()
    operator.record_mission_end()
    with refused("door.other-reservation", SafetyStop):
        operator.queue_mission("another", "a mission")
    operator.revoke_holder("me")
    operator.queue_mission("another", "a mission")
