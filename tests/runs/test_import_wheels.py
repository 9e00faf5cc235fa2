"""Wheels whose turns contradict the gyro, the accelerometer or the truth of a recording are refused with a remedy."""

import numpy as np
import pytest

from tests.codes import includes

IMU = [f"sensors.imu.z[{entry}]" for entry in range(3)]


def by_wheels(lab, track_m=0.3, truth=False):
    """Change the recording to wheel speeds instead of an odometer, and without a camera unless requested."""
    odometer = lab.map[lab.map.index("[sensors.odometer]") : lab.map.index("[truth]")]
    wheels = '[sensors.wheels]\nfile = "board"\nz = [{ column = "l", unit = "m/s" }, { column = "r", unit = "m/s" }]\n'
    lab.map = lab.map.replace(odometer, wheels)
    if not truth:
        lab.map = lab.map[: lab.map.index("[truth]")]
    half = 0.5 * track_m * lab.recording()[0]["wz"]
    lab.board |= {"l": lab.board["speed"] - half, "r": lab.board["speed"] + half}
    return lab


@pytest.mark.parametrize("track_m", [0.08, 0.3, 1.5])
@pytest.mark.parametrize("truth", [True, False])
def test_wheels_consistent_with_the_gyro_give_no_warning(lab, track_m, truth):
    assert by_wheels(lab, track_m, truth).codes() == ["no command yet"]


def test_an_inverted_gyro_is_detected_by_wheels_and_accelerometer(lab):
    lab.board["wz"] = -lab.board["wz"]
    reason = by_wheels(lab).refused(
        "recording.yaw-rates-opposite", wheels="[sensors.wheels]", reference=IMU[2]
    )
    assert includes(reason, "recording.cause-and-contradiction", key=IMU[1])
    assert includes(reason, "recording.write-gyro", gyro=IMU[2], scale="-1")
    assert not includes(reason, "recording.against-motion", key=IMU[1])
    mended_lab = lab.edit('"wz", unit = "rad/s"', '"wz", unit = "rad/s", scale = -1')
    assert mended_lab.codes() == ["no command yet"]


@pytest.mark.parametrize("flip", ["wheels", "imu"])
def test_swapped_wheels_and_an_inverted_imu_are_named_as_possible_causes(lab, flip):
    by_wheels(lab)
    if flip == "imu":
        lab.board["wz"], lab.board["ay"] = -lab.board["wz"], -lab.board["ay"]
    else:
        lab.board["l"], lab.board["r"] = lab.board["r"], lab.board["l"]
    reason = lab.refused("recording.yaw-rates-opposite", correlation=pytest.approx(-1.0))
    tables = {"wheels": "[sensors.wheels]", "gyro": IMU[2], "scale": "-1"}
    assert includes(reason, "recording.swap-or-upside-down", **tables)
    assert not includes(reason, "recording.against-motion")


def test_swapped_wheels_are_detected_by_the_camera(lab):
    by_wheels(lab, truth=True)
    lab.board["l"], lab.board["r"] = lab.board["r"], lab.board["l"]
    reason = lab.refused("recording.yaw-rates-opposite", wheels="[sensors.wheels]", reference="[truth]")
    assert includes(reason, "recording.swap-wheels", wheels="[sensors.wheels]")


@pytest.mark.parametrize(("factor", "width_m"), [(1 / 40, 0.0075), (40.0, 12.0)])
def test_wheels_with_an_impossible_yaw_rate_are_refused(lab, factor, width_m):
    by_wheels(lab, truth=False)
    for side in "lr":
        lab.board[side] = factor * lab.board[side]
    reason = lab.refused("recording.track", reference=IMU[2], track_m=pytest.approx(width_m))
    assert includes(reason, "recording.check-track", wheels="[sensors.wheels]", reference=IMU[2])
    assert includes(reason, "import.does-not-fit")


def test_wheels_uncorrelated_with_the_gyro_are_reported(lab):
    by_wheels(lab)
    noise = np.random.default_rng(2).normal(size=1500)
    lab.board["r"] = lab.board["l"] + noise
    (finding,) = (d for d in lab.run().findings if d.code == "unrelated")
    assert includes(
        finding.reason, "recording.yaw-rates-disagree", wheels="[sensors.wheels]", reference=IMU[2]
    )
