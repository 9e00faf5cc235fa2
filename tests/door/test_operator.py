"""The mailbox of the loop: what was dealt with is forgotten, and nothing else."""

import signal
import sys

import pytest

from baqueano.door.operator import Operator
from baqueano.errors import SafetyStop

PATIENCE_S = 20.0  # until what does not come counts as hung


def test_a_stop_that_comes_while_another_reason_is_dealt_with_stays():
    operator = Operator()
    acted_on = "the IMU is silent"
    operator.stop("the teacher stopped it")
    operator.forget(acted_on)
    assert operator.why(attended=False) == "the teacher stopped it"
    operator.forget("the teacher stopped it")
    assert operator.why(attended=False) == ""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no alarm")
@pytest.mark.parametrize(
    ("word", "args"), [("forget", ("the IMU is silent",)), ("stop", ("seen",)), ("hold", ("me",)), ("may_ask", ("me",))]
)  # fmt: skip
def test_a_signal_in_the_middle_of_any_word_waits_for_no_lock(word, args):
    operator, rung = Operator(), []

    def told_to_end(number, frame):
        operator.stop("the service was told to end")
        rung.append(number)

    def hung(number, frame):
        raise TimeoutError(f"{word} holds what the handler waits for")

    def ring(frame, event, arg):
        if frame.f_code is getattr(Operator, word).__code__ and event == "line":
            signal.raise_signal(signal.SIGTERM)
        return ring

    before = signal.signal(signal.SIGTERM, told_to_end), signal.signal(signal.SIGALRM, hung), sys.gettrace()
    signal.setitimer(signal.ITIMER_REAL, PATIENCE_S)
    sys.settrace(ring)
    try:
        getattr(operator, word)(*args)
    finally:
        sys.settrace(before[2])
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGALRM, before[1])
    assert len(rung) > 1
    assert operator.why(attended=False) == "the service was told to end"


def test_a_vehicle_that_stands_between_two_drives_of_its_holder_is_not_said_to_drive():
    operator = Operator()
    operator.ask("me", "a mission")
    with pytest.raises(SafetyStop, match=r"somebody else drives this vehicle just now.*baqueano robot stop"):
        operator.ask("another", "a mission")
    operator.next()
    operator.free()
    with pytest.raises(SafetyStop, match="somebody else has this vehicle between two drives"):
        operator.ask("another", "a mission")
    operator.release("me")
    operator.ask("another", "a mission")
