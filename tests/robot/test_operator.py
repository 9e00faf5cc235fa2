"""The mailbox of the loop: what was dealt with is forgotten, and nothing else."""

from baqueano.robot.operator import Operator


def test_a_stop_that_comes_while_another_reason_is_dealt_with_stays():
    operator = Operator()
    acted_on = "the IMU is silent"
    operator.stop("the teacher stopped it")
    operator.forget(acted_on)
    assert operator.why(attended=False) == "the teacher stopped it"
    operator.forget("the teacher stopped it")
    assert operator.why(attended=False) == ""
