"""Several runs from one file or several files, and the map entries for wheels and for unmeasured channels."""

from pathlib import Path

import numpy as np
import pytest

from baqueano.cli import main
from baqueano.cli.options import find_runs
from baqueano.errors import FileError
from baqueano.runs import import_run, import_runs, write_run
from baqueano.runs.folder import find, find_all
from baqueano.runs.importing import ImportedRuns
from tests.codes import includes, refused

HEAD = "trial,t,left,right,slow,rpm_l,rpm_r\n"
MAP = """
format = 1
[files.log]
time = "t"
time_unit = "s"
[command]
in_force = "until"
wheels = [{ column = "left", unit = "1" }, { column = "right", unit = "1" }]
[sensors.wheels]
z = [
  { column = "rpm_l", unit = "rpm", radius_m = 0.1 },
  { column = "rpm_r", unit = "rpm", radius_m = 0.1 },
]
"""


class Desk:
    def __init__(self, folder):
        self.folder = folder

    def map(self, *edits):
        text = MAP
        for old, new in edits:
            assert old in text
            text = text.replace(old, new)
        path = self.folder / "many.toml"
        path.write_text(text, encoding="utf-8")
        return path

    def file(self, name, trials, rows=5, restart=True):
        lines = []
        for n, trial in enumerate(trials):
            for k in range(rows):
                t = 0.1 * k if restart else 0.1 * k + 10.0 * n
                lines.append(f"{trial},{t:.3f},0.2,0.6,{k // 2},{30 * k},{60 * k}")
        path = self.folder / name
        path.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
        return path


@pytest.fixture
def desk(tmp_path):
    return Desk(tmp_path)


SPLIT = ('time_unit = "s"', 'time_unit = "s"\nsplit = "trial"')
GAP = ('time_unit = "s"', 'time_unit = "s"\nsplit_gap_s = 5.0')


def test_each_value_of_the_split_column_is_a_run_in_file_order(desk):
    imports = import_runs(desk.map(SPLIT), [desk.file("log.csv", [7, 2, 11])])
    assert [imported_run.run.name for imported_run in imports] == ["log-007", "log-002", "log-011"]
    assert [len(imported_run.run.t_ns) for imported_run in imports] == [5, 5, 5]


@pytest.mark.parametrize(
    ("selection", "labels"),
    [
        ('{ trial = { not = "parking" } }', ["a", "b", "003"]),
        ('{ trial = { not = ["parking", "b"] } }', ["a", "003"]),
        ('{ trial = ["b", "3.0"] }', ["b", "003"]),
        ('{ trial = { not = ["parking", "a", "b"], max = 3 } }', ["003"]),
        ('{ trial = "a" }', ["a"]),
        ("{ left = 0.2, rpm_l = { min = 30, not = 60.0 } }", ["parking", "a", "b", "003"]),
    ],
)
def test_the_where_key_accepts_several_words(desk, selection, labels):
    by_map = desk.map((SPLIT[0], f"{SPLIT[1]}\nwhere = {selection}"))
    imports = import_runs(by_map, [desk.file("log.csv", ["parking", "a", "b", "3.0"])])
    assert [imported_run.run.name for imported_run in imports] == [f"log-{label}" for label in labels]


@pytest.mark.parametrize(
    "selection", ['{ left = { min = "0" } }', "{ left = { max = [1] } }", "{ left = 2020-01-01 }"]
)
def test_an_invalid_where_key_is_refused_with_a_remedy(desk, selection):
    with refused("import.where", FileError, column="left"):
        import_runs(desk.map((SPLIT[0], f"{SPLIT[1]}\nwhere = {selection}")), [desk.file("log.csv", [1])])


@pytest.mark.parametrize("restart", [True, False])
def test_a_pause_or_restarted_time_begins_a_new_run(desk, restart):
    imports = import_runs(desk.map(GAP), [desk.file("log.csv", [1, 1, 1], restart=restart)])
    assert [imported_run.run.name for imported_run in imports] == ["log-1", "log-2", "log-3"]
    assert all(imported_run.run.duration_s == pytest.approx(0.4) for imported_run in imports)


def test_several_files_for_one_placeholder_are_imported_as_several_runs(desk):
    first, two = desk.file("one.csv", [1]), desk.file("two.csv", [1])
    assert [i.run.name for i in import_runs(desk.map(), [first, two])] == ["one", "two"]
    assert [i.run.name for i in import_runs(desk.map(), [desk.folder / "*.csv"])] == ["one", "two"]
    by_map = desk.map(('time = "t"', 'path = "*.csv"\ntime = "t"'))
    assert [i.run.name for i in import_runs(by_map)] == ["one", "two"]
    with refused("import.no-file-like", FileError):
        import_runs(desk.map(), [desk.folder / "none*.csv"])


def test_a_recording_of_several_runs_is_not_imported_as_a_single_run(desk):
    with refused("import.several-runs", FileError, count=2):
        import_run(desk.map(SPLIT), [desk.file("log.csv", [1, 2])])


def test_a_missing_first_command_is_reported_in_full_for_one_run_only(desk):
    path = desk.file("late.csv", [1, 2])
    path.write_text(path.read_text().replace("1,0.000,0.2,", "1,0.000,,"), encoding="utf-8")
    by_map = desk.map(SPLIT, ('in_force = "until"', 'in_force = "from"'))
    imports = tuple(import_runs(by_map, [path]))
    assert [
        [(d.code, d.usual) for d in imported_run.findings if d.level == "info"] for imported_run in imports
    ] == [[("no command yet", False)], [("no command yet", True)]]
    assert "in 1 of 2 runs; the first: 2 ticks before the first command" in " ".join(
        ImportedRuns(imports).table().split()
    )
    assert "no command yet" not in ImportedRuns(imports[1:]).table()
    assert "no command yet" not in imports[1].without_common_findings.table()


def test_several_runs_in_one_file_are_distinguished_from_delayed_rows(desk):
    path = desk.file("log.csv", [1, 2])
    path.write_text(path.read_text().replace("2,0.100,0.2,", "2,0.100,0.3,"), encoding="utf-8")
    with refused("import.clock-back", FileError, rows=4):
        import_runs(desk.map(), [path])
    log = desk.file("late.csv", [1], rows=30)
    text = log.read_text().replace("1,1.500,", "1,1.390,")
    log.write_text(text, encoding="utf-8")
    with refused("import.steps-back", FileError, count=1, rows=1):
        import_runs(desk.map(), [log])
    (single,) = import_runs(desk.map(('time_unit = "s"', 'time_unit = "s"\nbackwards = "drop"')), [log])
    assert includes(single.findings[0].reason, "recording.steps-back", table="late.csv", count=1, rows=1)


def test_parts_that_are_too_short_are_excluded_and_reported(desk):
    path = desk.file("log.csv", [1, 2])
    path.write_text(path.read_text() + "3,0.0,0,0,0,0,0\n", encoding="utf-8")
    imports = import_runs(desk.map(SPLIT), [path])
    assert len(imports) == 2
    assert [(d.reason.code, d.reason.figures) for d in imports[0].findings if d.code == "short"] == [
        ("recording.short-parts", {"count": 1, "minimum": 3, "names": "log-003"})
    ]
    assert "in 1 of 2 runs" in ImportedRuns(tuple(imports)).table()
    assert ImportedRuns(tuple(imports)).rows()[0]["run"] == "log-001"
    with refused("import.too-short", FileError, parts=2, rows=2):
        import_runs(desk.map(SPLIT), [desk.file("short.csv", [1, 2], rows=2)])


def test_a_second_reading_of_the_same_file_is_split_too(desk):
    slow = '[files.slow]\ntime = "t"\ntime_unit = "s"\nsplit = "trial"\nnew_when = "slow"\n[ticks]\nfile = "log"\n'
    by_map = desk.map(
        SPLIT,
        ("[command]", slow + '[command]\nfile = "log"'),
        ("[sensors.wheels]", '[sensors.wheels]\nfile = "slow"'),
    )
    imports = import_runs(by_map, [desk.file("log.csv", [1, 2])])
    assert [len(imported_run.run.sensors["wheels"].t_ns) for imported_run in imports] == [3, 3]


TWO = (
    (
        "[command]",
        '[files.odo]\ntime = "t"\ntime_unit = "s"\nsplit = "trial"\n[ticks]\nfile = "log"\n[command]\nfile = "log"',
    ),
    ("[sensors.wheels]", '[sensors.wheels]\nfile = "odo"'),
)


def speeds(imports):
    """Return the speed of the left wheel in the last row of each run, in the unit of the rows."""
    return {
        imported_run.run.name: round(imported_run.run.sensors["wheels"].z[-1, 0] / (np.pi / 10.0))
        for imported_run in imports
    }


def test_split_files_are_matched_by_value_and_not_by_order(desk):
    log = desk.file("log.csv", ["monday", "tuesday"])
    odo = desk.file("odo.csv", ["tuesday"], rows=5)
    path = desk.file("monday.csv", ["monday"], rows=4)
    odo.write_text(odo.read_text() + path.read_text().removeprefix(HEAD), encoding="utf-8")
    imports = import_runs(desk.map(SPLIT, *TWO), {"log": log, "odo": odo})
    assert speeds(imports) == {"log-monday": 3, "log-tuesday": 4}


@pytest.mark.parametrize("log", ["7", "7.0", "007"])
def test_split_values_written_as_7_and_7_0_are_equal(desk, log):
    files = {"log": desk.file("log.csv", [log, "2"]), "odo": desk.file("odo.csv", ["2", "7"])}
    assert list(speeds(import_runs(desk.map(SPLIT, *TWO), files))) == ["log-007", "log-002"]


def test_a_split_value_absent_from_one_file_is_excluded_and_reported(desk):
    log = desk.file("log.csv", ["monday", "tuesday"])
    odo = desk.file("odo.csv", ["parking", "tuesday", "monday", "home"])
    first, second = import_runs(desk.map(SPLIT, *TWO), {"log": log, "odo": odo})
    figures = {"map": "many.toml", "values": "trial = parking, home"}
    assert [d.reason.figures for d in first.findings if d.reason.code == "recording.not-in-all"] == [
        figures | {"file": "odo", "second_file": "log"}
    ]
    assert "not in all files" not in [d.code for d in second.findings]
    imports = import_runs(desk.map(SPLIT, *TWO), {"log": odo, "odo": log})
    assert list(speeds(imports)) == ["odo-tuesday", "odo-monday"]
    reason = imports[0].findings[0].reason
    assert (reason.code, reason.figures) == (
        "recording.not-in-all",
        figures | {"file": "log", "second_file": "odo"},
    )


def test_a_row_without_a_time_does_not_split_a_run(desk):
    log = desk.file("log.csv", [1, 1], restart=False)
    lines = log.read_text(encoding="utf-8").splitlines()
    lines[3] = lines[3].replace(",0.200,", ",,")
    log.write_text("\n".join(lines) + "\n", encoding="utf-8")
    first, second = import_runs(desk.map(GAP), [log])
    assert [len(r.run.t_ns) for r in (first, second)] == [4, 5]


def test_split_files_without_a_common_value_are_refused(desk):
    files = {"log": desk.file("log.csv", [1, 2]), "odo": desk.file("odo.csv", ["a", "b"])}
    with refused("import.split-no-value", FileError):
        import_runs(desk.map(SPLIT, *TWO), files)


def test_for_each_split_value_parts_after_a_pause_are_matched_in_order(desk):
    splits = ('split = "trial"', 'split = "trial"\nsplit_gap_s = 5.0')
    log = desk.file("log.csv", ["a", "b", "b"], restart=False)
    odo = desk.file("odo.csv", ["a", "b", "b"], restart=False)
    imports = import_runs(desk.map(SPLIT, *TWO, splits), {"log": log, "odo": odo})
    assert list(speeds(imports)) == ["log-a-1", "log-b-1", "log-b-2"]
    fewer = desk.file("odo.csv", ["b", "a", "b"], rows=1, restart=False)
    longer = desk.file("odo.csv", ["a", "b"], restart=False)
    for odometry in (fewer, longer):
        with refused(
            "import.parts-differ", FileError, counts="[files.log] 2, [files.odo] 1", split="trial", value="b"
        ):
            import_runs(desk.map(SPLIT, *TWO, splits), {"log": log, "odo": odometry})


def test_parts_separated_only_by_a_pause_are_matched_in_order(desk):
    by_map = desk.map(GAP, *TWO, ('split = "trial"', "split_gap_s = 5.0"))
    log = desk.file("log.csv", [1, 1], restart=False)
    imports = import_runs(by_map, {"log": log, "odo": desk.file("odo.csv", [1, 1], restart=False)})
    assert list(speeds(imports)) == ["log-1", "log-2"]
    with refused("import.parts-differ", FileError, counts="[files.log] 2, [files.odo] 3"):
        import_runs(by_map, {"log": log, "odo": desk.file("odo.csv", [1, 1, 1], restart=False)})
    desk_map = desk.map(SPLIT, *TWO, ('split = "trial"\n[ticks]', "split_gap_s = 5.0\n[ticks]"))
    runs_by_name = import_runs(desk_map, {"log": desk.file("log.csv", [3, 4], restart=False), "odo": log})
    assert list(speeds(runs_by_name)) == ["log-003", "log-004"]


def test_the_split_key_is_refused_outside_the_file_of_the_ticks(desk):
    table = '[files.other]\ntime = "t"\ntime_unit = "s"\n[ticks]\nfile = "other"\n'
    by_map = desk.map(
        SPLIT,
        ("[command]", table + '[command]\nfile = "log"'),
        ("[sensors.wheels]", '[sensors.wheels]\nfile = "log"'),
    )
    with refused("import.split-not-ticks", FileError):
        import_runs(by_map, [desk.file("log.csv", [1, 2])])


def test_wheel_speeds_are_converted_to_commands_and_rim_speeds(desk):
    run = import_run(desk.map(), [desk.file("log.csv", [1])]).run
    assert run.applied_commands[0] == pytest.approx([0.4, 0.0, 0.2])
    assert run.metadata["commands"] == "u_x, u_y, u_psi"
    assert run.sensors["wheels"].z[1] == pytest.approx(np.array([30.0, 60.0]) * np.pi / 30.0 * 0.1)


def test_an_unmeasured_channel_is_nan_without_a_warning(desk):
    imu = '[sensors.imu]\nz = [{ constant = nan }, { constant = nan }, { column = "t", unit = "rad/s" }]\n'
    imported_run = import_run(
        desk.map(("[sensors.wheels]", imu + "[sensors.wheels]")), [desk.file("log.csv", [1], rows=20)]
    )
    z = imported_run.run.sensors["imu"].z
    assert np.isnan(z[:, :2]).all()
    assert np.isfinite(z[:, 2]).all()
    assert "missing" not in [d.code for d in imported_run.findings]


def test_a_file_without_times_uses_a_fixed_rate(desk):
    by_map = desk.map(('time = "t"\ntime_unit = "s"', "rate_hz = 20.0"))
    log = desk.file("log.csv", [1])
    assert import_run(by_map, [log]).run.duration_s == pytest.approx(0.2)
    log.write_bytes(log.read_bytes().replace(b"\n", b"\r\r\n"))  # a CSV file of Python on Windows
    assert import_run(by_map, [log]).run.duration_s == pytest.approx(0.2)
    for text, message in (
        ("rate_hz = 0.0", ("expect.rate", {})),
        ('rate_hz = 5.0\ntime = "t"', ("expect.time", {})),
    ):
        with refused(message[0], FileError, **message[1]):
            import_run(desk.map(('time = "t"\ntime_unit = "s"', text)), [desk.file("log.csv", [1])])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("wheels = [", "u = [], wheels = [", ("map.not-toml", {})),
        ('"rpm", radius_m = 0.1', '"rpm"', ("expect.measures-or-rolls", {})),
        ('"rpm", radius_m', '"m/s", radius_m', ("expect.radius", {})),
        ('in_force = "until"', 'in_force = "until"\nnames = ["a"]', ("expect.three-names", {})),
        ('column = "rpm_l", unit = "rpm", radius_m = 0.1', 'unit = "m/s"', ("expect.one-source", {})),
    ],
)
def test_an_inconsistent_map_is_refused_with_a_remedy(desk, old, new, message):
    with refused(message[0], FileError, **message[1]):
        import_run(desk.map((old, new)), [desk.file("log.csv", [1])])


def test_a_map_with_two_definitions_of_the_command_is_refused(desk):
    table = ("[sensors.wheels]", "[sensors.wheels]")
    with refused("expect.u-or-wheels", FileError):
        import_run(desk.map(("wheels = [{", "u = []\nwheels = [{"), table), [desk.file("log.csv", [1])])


def test_runs_are_selected_by_numbers_patterns_and_folders(desk, make_run):
    folder = desk.folder / "runs"
    folder.mkdir()
    paths = [write_run(make_run(N=5), folder / f"{k:04d}-a{k % 2}.mcap") for k in range(1, 7)]
    assert find_all("2-5", folder) == paths[1:5]
    assert find_all("1-6:2", folder) == paths[0::2]
    assert find_all("*-a0", folder) == paths[1::2]
    assert find_all(str(folder), folder) == paths
    assert find_all(str(folder / "000[12]*.mcap"), folder) == paths[:2]
    assert find_all(str(folder / "000[12]-a1.mcap"), folder) == paths[:1]
    assert find_all("3", folder) == [paths[2]]
    assert [run.name for run in find_runs(("3", "1-3"), str(folder))] == ["0003-a1", "0001-a1", "0002-a0"]
    with refused("runs.no-match", FileError):
        find_all("90-95", folder)
    (folder / "empty").mkdir()
    with refused("runs.folder-without-runs", FileError):
        find_all(str(folder / "empty"), folder)


def test_a_run_named_by_a_fraction_is_found_by_its_name(desk, monkeypatch, capsys):
    monkeypatch.chdir(desk.folder)
    log = desk.file("LOG.CSV", [0.5, 0.7])
    with pytest.raises(SystemExit):
        main(["runs", "import", str(desk.map(SPLIT)), str(log)])
    advised_names = [word for word in capsys.readouterr().err.split() if word.startswith("000")]
    assert advised_names == ["0001-LOG-0.5", "0002-LOG-0.7"]
    assert [find(name).name for name in advised_names] == ["0001-LOG-0.5.mcap", "0002-LOG-0.7.mcap"]
    assert str(find("away/other.mcap")) == str(Path("away/other.mcap"))


def test_split_values_cannot_write_outside_the_requested_folder(desk, monkeypatch):
    monkeypatch.chdir(desk.folder)
    log, by_map = desk.file("log.csv", ["x/../../../out", "\x1b[2Jb"]), desk.map(SPLIT)
    with pytest.raises(SystemExit) as exit_info:
        main(["runs", "import", str(by_map), str(log), "-o", "here/deep"])
    assert not exit_info.value.code
    files = sorted(str(path.relative_to(desk.folder)) for path in desk.folder.rglob("*.mcap"))
    assert files == ["here/deep/log-[2Jb.mcap", "here/deep/log-x......out.mcap"]
