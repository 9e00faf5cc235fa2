"""A guide at another pace follows the same path in another time."""

import numpy as np
import pytest

from baqueano.drive.safety.paced_guide import PacedGuide
from baqueano.guides import GuideAtPace, Repeat, RepeatByProgress
from baqueano.guides.shapes import circle
from tests.guides.test_drive_to import DT, estimate_at

ROUTE = circle(0.5, 0.2)


def drive_guide(guide, ticks, requests=None):
    state, out, pose = guide.init(), [], ROUTE.eta[0]
    for k in range(ticks):
        if requests and k in requests:
            guide.set_pace("holder", requests[k])
        state, reference = guide.step(state, estimate_at(pose, k))
        out.append(reference)
        pose = reference.eta
    return out


@pytest.mark.parametrize("kind", [Repeat, RepeatByProgress])
def test_at_full_pace_the_guide_is_unchanged(kind):
    poses, paced_poses = drive_guide(kind.along(ROUTE), 60), drive_guide(GuideAtPace(kind.along(ROUTE)), 60)
    for a, b in zip(poses, paced_poses, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_a_pause_brakes_the_guide_and_then_continues_from_the_same_place():
    guide = PacedGuide(Repeat.along(ROUTE))
    out = drive_guide(guide, 400, {80: 0.0, 250: 1.0})
    v = np.array([r.nu[0] for r in out])
    path_m = np.unwrap([r.eta[2] for r in out]) * 0.5
    assert v[79] == pytest.approx(0.2)
    assert np.max(np.abs(np.diff(v))) <= 0.2 * DT / guide.block.ramp_s + 1e-9
    assert np.ptp(path_m[100:250]) < 1e-9
    assert np.all(v[100:250] == 0.0)
    assert v[-1] == pytest.approx(0.2)
    begin_ticks = 0.5 * 0.2 / 0.3 / DT
    # no part is skipped
    assert path_m[-1] == pytest.approx(0.2 * DT * (400 - 170 - begin_ticks), abs=0.2 * DT * 5)


def test_the_slowest_of_several_requested_paces_applies():
    guide = PacedGuide(Repeat.along(ROUTE))
    guide.set_pace("caution", 0.5)
    guide.set_pace("holder", 0.8)
    assert guide.pace == 0.5
    guide.set_pace("caution", 1.0)
    assert guide.pace == 0.8
    with pytest.raises(ValueError, match="pace"):
        guide.set_pace("holder", 2.0)
