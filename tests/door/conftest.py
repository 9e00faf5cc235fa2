"""A door without a service, and its clients."""

import pytest

from baqueano.door.operator import Operator
from baqueano.door.sockets import Door


@pytest.fixture
def door(tmp_path):
    door = Door(tmp_path / "s", Operator(), tmp_path)
    yield door
    door.close()


@pytest.fixture
def connect(door):
    """Return a function that connects one more client to the door."""
    from tests.door.test_sockets import Person

    people = []

    def add_person():
        people.append(Person(door.path))
        return people[-1]

    yield add_person
    for person in people:
        person.close()
