"""A mission is sent as text and then drives the same, bit for bit, with the blocks of the user."""

import numpy as np
import pytest

from baqueano import vehicle_file
from baqueano.drive import experiment, repeat
from baqueano.drive.mission import Mission, pack, perform, unpack
from baqueano.drive.safety.precautions import Precautions
from baqueano.errors import FileError, UsageError
from baqueano.guides import shapes
from tests.codes import refused

CONTROLLER = """
import numpy as np
from baqueano.signals import Command

class Slow:
    def init(self):
        return None
    def step(self, state, reference, estimate):
        return state, Command(estimate.t_ns, np.array([{size}, 0.0, 0.0]))
"""


def send(mission, tmp_path):
    """Return the mission and its vehicle file as the receiver decodes them."""
    mission_received = Mission.from_json(mission.to_json())
    tmp_path.mkdir(exist_ok=True)
    return mission_received, unpack(mission_received, tmp_path)


U, CIRCLE = np.random.default_rng(0).uniform(-1, 1, (50, 3)) * [1, 0, 1], shapes.circle(0.3, 0.4)


@pytest.mark.parametrize(
    ("mission", "drive"),
    [
        (Mission("experiment", u=U), lambda file: experiment(file, U)),
        (Mission("repeat", route=CIRCLE, laps=1), lambda file: repeat(file, CIRCLE, laps=1)),
    ],
)
def test_a_mission_sent_as_text_gives_the_same_estimate(tmp_path, mission, drive):
    file = vehicle_file.load("small")
    mission_received, file_received = send(pack(mission, file), tmp_path)
    estimate = perform(mission_received, file_received).estimate
    np.testing.assert_array_equal(estimate.eta, drive(file).estimate.eta)


def test_a_repetition_without_patience_is_sent_as_text(tmp_path):
    care = Precautions(patience_s=np.inf)
    mission = Mission("repeat", route=shapes.circle(0.3, 0.4), precautions=care.to_json())
    assert Precautions.from_json(Mission.from_json(mission.to_json()).precautions) == care


def test_user_blocks_are_packed_into_the_mission(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slow.py").write_text(CONTROLLER.format(size=0.5))
    mission = pack(
        Mission("repeat", route=shapes.circle(0.3, 3.0), blocks={"controller": "slow.py:Slow"}),
        vehicle_file.load("small"),
    )
    (tmp_path / "slow.py").unlink()
    mission_received, file_received = send(mission, tmp_path / "robot")
    run = perform(mission_received, file_received)
    assert np.all(run.without_rest.requested_commands[:, 0] == 0.5)


@pytest.mark.parametrize("quote", ['"', "'"])
def test_a_block_in_a_folder_is_packed_with_each_quote_of_toml(tmp_path, monkeypatch, quote):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "slow.py").write_text(CONTROLLER.format(size=0.5))
    text = vehicle_file.load("small").text
    (tmp_path / "vehicle.toml").write_text(
        text.replace('"pd_feedforward"', f"{quote}mine/slow.py:Slow{quote}")
    )
    mission_json = pack(Mission("teach"), vehicle_file.load("vehicle.toml"))
    assert 'kind = "slow.py:Slow"' in mission_json.vehicle
    assert [*mission_json.texts] == ["slow.py"]


def test_two_files_of_the_same_name_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").mkdir()
    (tmp_path / "slow.py").write_text(CONTROLLER.format(size=0.5))
    (tmp_path / "a" / "slow.py").write_text(CONTROLLER.format(size=0.6))
    blocks = {"controller": "slow.py:Slow", "guide": "a/slow.py:Slow"}
    with refused("mission.two-files", FileError):
        pack(Mission("repeat", route=shapes.circle(0.3, 0.6), blocks=blocks), vehicle_file.load("small"))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("{", ("mission.damaged", {})),
        ("{}", ("mission.damaged", {})),
        ('{"format": 9, "kind": "repeat"}', ("mission.version", {})),
        ("[1]", ("mission.damaged", {})),
    ],
)
def test_an_invalid_mission_is_refused(text, fault):
    with refused(fault[0], UsageError, **fault[1]):
        Mission.from_json(text)


def test_a_mission_writes_nothing_outside_its_folder(tmp_path):
    mission = Mission("teach", vehicle=vehicle_file.load("small").text, texts={"../evil.py": "x = 1"})
    with refused("mission.file-name", UsageError):
        unpack(mission, tmp_path)
    with refused("mission.kind", UsageError):
        Mission("dance")


@pytest.mark.parametrize(("kind", "lacks"), [("experiment", "u"), ("repeat", "route")])
def test_an_incomplete_mission_is_refused_before_sending(kind, lacks):
    with refused("mission.lacks", UsageError, kind=kind, name=lacks):
        Mission(kind)
    with refused("mission.lacks", UsageError, kind=kind, name=lacks):
        Mission.from_json(Mission("teach").to_json().replace('"teach"', f'"{kind}"'))
