"""An error has the same exit code on the vehicle and on the laptop."""

import io
import json

import pytest

from baqueano.door.mission.outcome import mission_outcome
from baqueano.door.remote import Remote
from baqueano.errors import AnswerNo, FileError, RobotUnreachable, SafetyStop, UsageError, exit_code_error
from baqueano.guides.shapes import shape

KINDS = [AnswerNo, UsageError, FileError, RobotUnreachable, SafetyStop]


def vehicle(**message):
    """A service that answers with this error."""
    return Remote(io.BytesIO(), io.BytesIO(json.dumps(message).encode() + b"\n"), "rover")  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
def test_an_exit_code_is_converted_back_to_its_error_type(kind):
    error = exit_code_error(kind.exit_code, "reason")
    assert (type(error), str(error)) == (kind, "reason")


@pytest.mark.parametrize("kind", KINDS)
def test_an_error_of_the_vehicle_is_raised_on_the_laptop(kind):
    with pytest.raises(kind, match="reason") as error_info:
        vehicle(**{"type": "refused", "reason": "reason", "code": kind.exit_code}).receive(("state",), 5.0)
    assert type(error_info.value) is kind


def test_a_refused_value_keeps_its_code_at_the_end_of_a_mission():
    reason, code = mission_outcome(lambda: shape("circel", 1.0, 0.2))
    assert (reason.code, code) == ("shape.unknown", UsageError.exit_code)
