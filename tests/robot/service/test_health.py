"""The conditions of a drive: a check that cannot be made does not end the service."""

import math
from dataclasses import replace
from types import SimpleNamespace

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.robot.service.health import ComputerHealth

AT_REST = SimpleNamespace(tilt_rad=0.0, battery_v=math.nan)


def test_a_removed_folder_of_runs_does_not_end_the_service(tmp_path):
    folder, limits = tmp_path / "runs", replace(vehicle_file.load("small").robot, least_disk_mb=1e12)
    health = ComputerHealth(limits, folder, lambda: 0, tmp_path / "no thermometer")
    assert health.start_obstacle(AT_REST) is None
    folder.mkdir()
    assert health.start_obstacle(AT_REST).code == StopReason.DISK_FULL
