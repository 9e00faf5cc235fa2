"""An error keeps its exit code on the way from the vehicle to the laptop."""

import io
import json

import pytest

from baqueano.door.remote import Remote
from baqueano.errors import AnswerNo, FileError, RobotUnreachable, SafetyStop, UsageError, of_code

KINDS = [AnswerNo, UsageError, FileError, RobotUnreachable, SafetyStop]


def vehicle(**message):
    """A service that answers with this error."""
    return Remote(io.BytesIO(), io.BytesIO(json.dumps(message).encode() + b"\n"), "rover")  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
def test_a_code_is_that_of_the_error_that_it_came_from(kind):
    error = of_code(kind.exit_code, "why")
    assert (type(error), str(error)) == (kind, "why")


@pytest.mark.parametrize("kind", KINDS)
def test_what_the_vehicle_refuses_is_refused_here_for_the_same_reason(kind):
    with pytest.raises(kind, match="why") as error_info:
        vehicle(**{"is": "no", "why": "why", "code": kind.exit_code}).hear(("state",), 5.0)
    assert type(error_info.value) is kind
