"""Logs of several topics: rows with the same time are joined, and commands may be logged only when they change."""

import numpy as np


def in_two_rows(columns):
    """Return the columns as written by a logger with a row for each topic: the IMU, then all other cells."""
    n, imu = len(columns["t"]), {"ax", "ay", "wz"}
    rows = {
        name: np.where(np.tile([name in imu, name not in imu], n), np.repeat(column, 2), np.nan)
        for name, column in columns.items()
    }
    return rows | {"t": np.repeat(columns["t"], 2)}


def test_rows_of_two_topics_with_the_same_time_are_joined(lab):
    expected, _ = lab.run()
    lab.board = in_two_rows(lab.board)
    run, findings = lab.run()
    join_findings = [d for d in findings if d.reason.code == "recording.joined"]
    figures = {"table": "board.csv", "count": 3000, "times": 1500, "line": 2}
    assert [(d.reason.figures, d.level) for d in join_findings] == [(figures, "info")]
    assert not [d for d in findings if d.reason.code in ("recording.missing", "recording.repeats")]
    assert np.array_equal(run.applied_commands, expected.applied_commands)
    for name, channel in expected.sensors.items():
        assert np.array_equal(run.sensors[name].z, channel.z)
        assert np.array_equal(run.sensors[name].t_ns, channel.t_ns)


def test_rows_of_one_time_with_two_values_of_a_column_are_refused(lab):
    lab.board = in_two_rows(lab.board)
    lab.board["ax"][201] = 0.5  # row 200 gives another value
    lab.refused("import.repeats")


def test_the_empty_cells_of_a_slower_topic_are_reported_and_those_of_lost_readings_are_a_warning(lab):
    speed = lab.board["speed"].copy()
    lab.board["speed"] = np.where(np.arange(len(speed)) % 5 == 0, speed, np.nan)
    assert [d.level for d in lab.run().findings if d.code == "missing"] == ["info"]
    lab.board["speed"] = np.where(
        (np.arange(len(speed)) > 300) & (np.arange(len(speed)) < 1200), np.nan, speed
    )
    assert [d.level for d in lab.run().findings if d.code == "missing"] == ["warning"]


def test_commands_that_are_logged_only_when_they_change_have_no_gaps(lab):
    rng = np.random.default_rng(0)
    t_s = np.cumsum(rng.choice([0.2, 0.5, 1.0, 3.0], 18))
    rows = [f"{t:.2f},{rng.uniform():.3f},{rng.uniform(-0.3, 0.3):.3f}" for t in [0.0, *t_s]]
    (lab.folder / "keys.csv").write_text("\n".join(["t,throttle,steer", *rows]), encoding="utf-8")
    lab.edit('[command]\nfile = "board"', '[command]\nfile = "keys"')
    lab.edit("[ticks]", '[files.keys]\npath = "keys.csv"\ntime = "t"\ntime_unit = "s"\n[ticks]')
    run, findings = lab.run()
    assert not [d for d in findings if d.reason.code in ("recording.gap", "recording.more-gaps")]
    changes_s = run.t_s[1:][np.any(np.diff(run.applied_commands, axis=0) != 0.0, axis=1)]
    assert len(changes_s) == np.count_nonzero(t_s < run.t_s[-1])
