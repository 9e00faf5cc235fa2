"""A run reports the punctuality of its ticks for every end of the drive: in lock-step, so that delays are exact."""

import numpy as np

from baqueano import vehicle_file
from baqueano.diagnostics import StopReason
from baqueano.drive.mission import Mission, pack
from baqueano.drive.recording import CLOCK_SOURCE
from tests.emulated.drives import TEACHER, drive, during, spin


def punctuality(run):
    (event,) = [e for e in run.events if e.source == CLOCK_SOURCE]
    assert event.t_ns == run.t_ns[-1]
    return event


def test_a_punctual_drive_is_reported_in_its_run(service):
    _, run = drive(service, spin())
    assert punctuality(run).level == "info"
    assert punctuality(run).text.startswith(f"{len(run.t_ns)} ticks: ")
    assert punctuality(run).text.endswith(" 0 were skipped")


def test_rt1_omitted_ticks_are_counted_with_a_warning(service, robot):
    during(service, robot, 0.5, lambda: robot.wait(0.05))
    end, run = drive(service, spin())
    assert end["reason"] is None
    missing = np.diff(run.t_ns) // 10_000_000 - 1
    assert missing.max() >= 4
    assert punctuality(run).level == "warning"
    assert punctuality(run).text.endswith(f" {missing.sum()} were skipped")
    assert any(m["type"] == "event" and m["message"] == punctuality(run).diagnostic for m in service.messages)


def test_a_stopped_drive_reports_its_punctuality(service, robot):
    during(service, robot, 0.5, lambda: service.operator.stop(TEACHER))
    end, run = drive(service, spin(3.0))
    assert end["reason"] == TEACHER
    assert punctuality(run).text.startswith(f"{len(run.t_ns)} ticks: ")


def test_a_drive_ended_by_the_driver_reports_its_punctuality(service, robot):
    holder = object()
    service.operator.set_holder(holder)

    def enough():
        service.operator.record_heartbeat(holder)
        service.operator.request_end(holder)

    during(service, robot, 0.2, enough)
    end, run = drive(service, spin(3.0), attended=True)
    assert end["reason"].code == StopReason.INTERRUPTED
    assert "ticks: " in punctuality(run).text


def test_a_first_drive_on_the_vehicle_writes_a_run(service):
    """Its result is computed on the laptop that receives the run."""
    end, run = drive(service, pack(Mission("first drive"), vehicle_file.load("small")))
    assert end["code"] == 0
    assert run.metadata["kind"] == "first drive"
    assert len(run.t_ns) > 100
