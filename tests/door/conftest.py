"""A door without a service, and its clients."""

import pytest

from baqueano.door.operator import Operator
from baqueano.door.sockets import Door


@pytest.fixture
def door(tmp_path, until_end):
    return until_end(Door(tmp_path / "s", Operator(), tmp_path))


@pytest.fixture
def connect(door, until_end):
    """Return a function that connects one more client to the door."""
    from tests.door.test_sockets import Person

    return lambda: until_end(Person(door.path))
