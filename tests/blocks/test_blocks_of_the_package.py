"""Each block of the package passes the check of blocks on each vehicle of the garage, as its users see it."""

from functools import cache

import numpy as np
import pytest

from baqueano.block_checks import check
from baqueano.blocks import BLOCK_TARGETS, resolve
from baqueano.controllers import DelayedController, ManualController, Schedule
from baqueano.controllers.heading_hold import Gains, HeadingHold
from baqueano.door.mission.gain_changes import AdjustableController
from baqueano.drive.safety.paced_guide import PacedGuide
from baqueano.guides import DriveTo, GuideAtPace, GuideSequence, Idle, Repeat, RepeatByProgress
from baqueano.guides.shapes import circle
from baqueano.messages import texts
from baqueano.project.my_controller import MyController
from baqueano.project.my_estimator import MyEstimator
from baqueano.project.my_guide import MyGuide
from baqueano.vehicle_file import block_check, load

FILES = ("small", "car", "case-study-1")
GAINS_OF_PD = {"alpha": 4.0, "beta": 1.0, "gamma": 0.1}
LAP = circle(1.0, 0.2)
SENSOR_ARGUMENTS = {
    "wheels": {"track_m": 0.1, "noise_std": 0.01}, "encoders": {"track_m": 0.1, "count_m": 1e-3},
    "tags": {"points_m": np.array([[0.5, 0.0], [0.0, 0.5]])}, "beacon": {"point_m": np.array([2.0, 1.0])},
    "rangefinder": {"wall_point_m": np.array([3.0, 0.0]), "wall_heading_rad": np.pi},
}  # fmt: skip

file_of = cache(load)


def block_of(role, kind, file):
    if role == "controller":
        return file.controller(kind, **(GAINS_OF_PD if kind == "pd" else {}))
    if role == "guide":
        return file.guide(LAP, kind)
    if role == "vehicle":
        return file.vehicle
    if role == "sensor":
        arguments = SENSOR_ARGUMENTS.get(kind)
        return resolve("sensor", kind)(**arguments) if arguments else kind
    return file.supervisor() if role == "supervisor" else file.estimator(kind)


CASES = [
    *((role, kind, "small") for role in ("guide", "sensor") for kind in BLOCK_TARGETS[role]),
    *(
        (role, kind, name)
        for role in ("estimator", "controller")
        for kind in BLOCK_TARGETS[role]
        for name in ("small", "car")
    ),
    ("estimator", "ekf", "case-study-1"),  # of the paper
    *(("supervisor", "of the file", name) for name in FILES),
    *(
        ("vehicle", "of the file", name)
        for name in (*FILES, "examples/omni_robot.toml", "examples/servo_axis.toml")
    ),
]


@pytest.mark.parametrize(("role", "kind", "name"), CASES)
def test_a_block_of_the_package_passes_the_check(role, kind, name):
    file = file_of(name)
    result = block_check.check(block_of(role, kind, file), file, role)
    assert texts(result.findings) == []
    assert kind == "mpc" or texts(result.notes) == []  # the program of "mpc" cannot be compiled


def other_blocks():
    """Return role and block of the blocks without a kind, but not `Inertial` and `Playback`: no user can name them.

    `Playback` repeats the clock of a run. `Inertial` gives the displacement of the pulses of a first drive.
    """
    file = file_of("small")
    law = file.controller()
    hold = HeadingHold(ManualController(lambda: [0.3, 0.0, 0.0]), Gains(0.1, 0.1, 0.01, 0.2), limit=1.0)
    return {
        "Schedule": ("controller", Schedule.at_rate(np.full((200, 3), 0.1), 50.0)),
        "DelayedController": ("controller", DelayedController(law, 0.5, 3)),
        "HeadingHold": ("controller", hold),
        "AdjustableController": ("controller", AdjustableController(law)),
        "MyController": ("controller", MyController()),
        "MyEstimator": ("estimator", MyEstimator(file.vehicle, file.sensors)),
        "MyGuide": ("guide", MyGuide(LAP.t_s, LAP.eta, LAP.nu, closed=True)),
        "Idle": ("guide", Idle(2.0)),
        "DriveTo": ("guide", DriveTo.to_route(LAP)),
        "GuideAtPace": ("guide", GuideAtPace(Repeat.along(LAP), pace=0.5)),
        "PacedGuide": ("guide", PacedGuide(Repeat.along(LAP))),
        "lead-in": ("guide", GuideSequence.with_lead_in(RepeatByProgress.along(LAP), LAP)),
        "way back": ("guide", GuideSequence.with_way_back(Repeat.along(LAP), LAP)),
    }


OTHER_BLOCKS = other_blocks()


@pytest.mark.parametrize("name", OTHER_BLOCKS)
def test_another_block_of_the_package_passes_the_check(name):
    role, block = OTHER_BLOCKS[name]
    findings = check(role, block, file_of("small").sensors)
    assert [finding for finding in findings if finding.code != "check.not-frozen"] == []
