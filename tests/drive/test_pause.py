"""A person pauses a drive, moves the vehicle and continues: it stays where it is put, then joins its route."""

import numpy as np
import pytest

from baqueano.drive.safety.paced_guide import PacedGuide
from baqueano.drive.safety.precautions import approach_limits
from baqueano.geometry import compose
from baqueano.guides import DriveTo, GuideSequence, Repeat, RepeatByProgress
from baqueano.guides.shapes import circle
from baqueano.signals import Estimate
from baqueano.symbolic import compile_block
from baqueano.vehicle_file import load

SMALL = load("small")
RADIUS_M = 0.6
LAP = circle(RADIUS_M, 0.2)
LIMITS = approach_limits(LAP, SMALL)
LAW, VEHICLE = compile_block(SMALL.controller()), compile_block(SMALL.vehicle)
GUIDES = {
    "by time": Repeat.along(LAP, 2),
    "by progress": RepeatByProgress.along(LAP, 2),
    "lead-in": GuideSequence.with_lead_in(Repeat.along(LAP, 2), LAP, **LIMITS),
}


def drive(guide, paces, pushes, seconds, start=LAP.eta[0]):
    """Return times (N,), poses (N, 3), speeds (N,) and commands (N, 3) of a vehicle whose pose is known."""
    paced_guide = PacedGuide(guide, DriveTo(LAP.eta[:1], **LIMITS))
    states, hz = [paced_guide.init(), LAW.init()], SMALL.rate_hz
    motion, rows = SMALL.vehicle.init(eta=np.array(start), nu=np.zeros(3)), []
    for k in range(round(seconds * hz)):
        t_s = k / hz
        if t_s in paces:
            paced_guide.set_pace("holder", paces[t_s])
        if t_s in pushes:
            motion = motion._replace(eta=compose(motion.eta, np.array(pushes[t_s])))
        estimate = Estimate(round(t_s * 1e9), motion.eta, motion.nu, 1e-6 * np.eye(6))
        states[0], reference = paced_guide.step(states[0], estimate)
        states[1], command = LAW.step(states[1], reference, estimate)
        rows.append([t_s, *motion.eta, motion.nu[0], *command.u])
        motion, _ = VEHICLE.step(motion, command.u, 1.0 / hz, np.zeros(3))
    t_s, *columns = np.array(rows).T
    return t_s, np.array(columns[:3]).T, columns[3], np.array(columns[4:]).T


def cross_track_m(poses):
    return np.abs(np.hypot(poses[:, 0], poses[:, 1] - RADIUS_M) - RADIUS_M)


@pytest.mark.parametrize("kind", GUIDES)
@pytest.mark.parametrize("push", [(0.0, 0.2, 0.5), (0.3, 0.0, 0.0), (-0.3, 0.0, 0.0), (0.0, -0.25, 2.5)])
def test_a_vehicle_stays_where_a_person_puts_it_in_a_pause_and_then_joins_its_route(kind, push):
    """Before, it drove back to the place of the pause during the pause."""
    t_s, poses, speed, u = drive(GUIDES[kind], {4.0: 0.0, 9.0: 1.0}, {6.0: push}, 16.0)
    is_pause, is_after = (t_s > 6.0) & (t_s < 9.0), t_s >= 9.0
    assert np.ptp(poses[is_pause], axis=0) == pytest.approx(0.0, abs=1e-3)
    assert np.max(np.abs(u[is_pause])) < 0.01
    assert np.min(speed[is_after]) > -0.01  # it does not reverse
    assert np.max(speed[is_after]) < 0.22  # and does not hurry
    assert np.max(cross_track_m(poses[t_s > 14.0])) < 0.005


@pytest.mark.parametrize("pause_s", [0.0, 0.3, 1.0, 2.0, 4.0])
def test_a_path_to_the_route_can_be_paused_at_any_time(pause_s):
    """The vehicle is moved in the pause, and once more in a pause of the path from there."""
    start = compose(LAP.eta[0], np.array([-0.4, 0.2, 0.5]))
    paces = {pause_s: 0.0, pause_s + 3.0: 1.0, pause_s + 4.0: 0.0, pause_s + 6.0: 1.0}
    pushes = {pause_s + 2.0: (0.1, 0.1, 0.3), pause_s + 5.0: (-0.05, -0.2, -0.5)}
    t_s, poses, speed, _ = drive(GUIDES["lead-in"], paces, pushes, pause_s + 15.0, start)
    for begin_s, end_s in ((2.0, 3.0), (5.0, 6.0)):
        is_pause = (t_s > pause_s + begin_s) & (t_s < pause_s + end_s)
        assert np.ptp(poses[is_pause], axis=0) == pytest.approx(0.0, abs=1e-3)
    assert np.min(speed) > -0.01
    assert np.max(cross_track_m(poses[t_s > pause_s + 13.0])) < 0.005


@pytest.mark.parametrize("kind", GUIDES)
def test_a_pause_without_a_push_does_not_change_the_path(kind):
    _, plain_poses, *_ = drive(GUIDES[kind], {}, {}, 10.0)
    t_s, poses, _, _ = drive(GUIDES[kind], {4.0: 0.0, 7.0: 1.0}, {}, 13.0)
    assert np.max(cross_track_m(poses)) < np.max(cross_track_m(plain_poses)) + 0.002
    assert np.hypot(*(poses[-1] - plain_poses[-1])[:2]) < 0.15  # only the ramps cost time
    assert np.ptp(poses[(t_s > 5.5) & (t_s < 7.0), :2], axis=0) == pytest.approx(0.0, abs=1e-3)
