"""A sensor of the run that the vehicle file lacks is reported once, with a remedy."""

from dataclasses import replace

import numpy as np

from baqueano.identify.dataset import unused_sensors
from baqueano.runs.run import Channel
from baqueano.vehicle_file import load


def with_more(run, **sizes: int):
    def channel(m: int) -> Channel:
        return Channel(run.t_ns, run.t_ns, np.zeros((len(run.t_ns), m)))

    return replace(run, sensors=run.sensors | {name: channel(m) for name, m in sizes.items()})


def test_a_sensor_missing_in_the_file_is_reported_with_a_remedy(case_run, case):
    run = with_more(case_run(0, 2.0), odometer=1, rollers=2, battery=1, imu_temperature=1)
    notes = unused_sensors([run, run], case)
    assert len(notes) == 2, "reported once for all runs, without battery and temperature"
    assert [note.code for note in notes] == ["use.not-in-file"] * 2
    assert notes[0].figures == {"sensor": "odometer", "vehicle": "case-study-1", "kind": "odometer"}
    assert notes[1].figures["kind"] == "wheels"
    assert unused_sensors([case_run(0, 2.0)], case) == []


def test_an_unused_sensor_is_reported_unless_the_user_chooses_sensors(
    case_run, tmp_path, monkeypatch, capsys
):
    import pytest

    from baqueano.cli import main
    from baqueano.runs import write_run

    monkeypatch.chdir(tmp_path)
    write_run(with_more(case_run(0, 5.0), odometer=1), tmp_path / "run.mcap")
    texts = []
    for use in ([], ["--use", "imu"]):
        with pytest.raises(SystemExit):
            main(["identify", "run.mcap", "--vehicle", "case-study-1", "--no-noise", *use])
        texts.append("has sensor odometer, which" in capsys.readouterr().err)
    assert texts == [True, False]
    assert load("case-study-1").sensors._fields == ("imu",)
