"""The folder of runs, the contents of a run, and its export as CSV, TUM and routes."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from baqueano.diagnostics import note
from baqueano.errors import FileError, UsageError
from baqueano.guides.route import Route
from baqueano.messages import text as sentence_of
from baqueano.messages.language import translate, use_language
from baqueano.runs import (
    Channel,
    Event,
    Run,
    export_csv,
    export_tum,
    find,
    listing,
    read_route,
    recover,
    show,
    write_route,
    write_run,
)
from baqueano.runs.folder import find_all, new_path, reserve_path
from baqueano.runs.folder_listing import listing_rows, listing_table
from tests.codes import refused


def test_runs_are_numbered_consecutively(run, tmp_path):
    folder = tmp_path / "José Núñez" / "runs"
    assert new_path(folder, "experiment").name == "0001-experiment.mcap"
    write_run(run, new_path(folder, "experiment"))
    assert new_path(folder, "my lap: 3/4?").name == "0002-my-lap-34.mcap"
    assert new_path(folder, " ../ ").name == "0002-run.mcap"
    write_run(run, folder / "9999-late.mcap")
    assert new_path(folder, "x").name == "10000-x.mcap"
    assert new_path(folder, "x" * 300).name == f"10000-{'x' * 60}.mcap"


def test_two_programs_never_get_the_same_run_number(tmp_path):
    assert [reserve_path(tmp_path, "x").name for _ in range(3)] == [
        "0001-x.mcap",
        "0002-x.mcap",
        "0003-x.mcap",
    ]


def test_a_folder_that_cannot_be_created_is_reported(tmp_path):
    (tmp_path / "runs").write_text("a file", encoding="utf-8")
    with refused("runs.folder-not-made", FileError):
        new_path(tmp_path / "runs", "x")


def test_a_run_is_selected_by_path_number_name_or_last(run, tmp_path):
    first, second = tmp_path / "0001-a.mcap", tmp_path / "0002-b.mcap"
    for path in (first, second, tmp_path / "loose.mcap"):
        write_run(run, path)
    assert find(str(first), tmp_path) == first
    assert find("2", tmp_path) == find("0002", tmp_path) == find("last", tmp_path) == second
    assert find("0001-a", tmp_path) == first
    assert find("loose", tmp_path) == tmp_path / "loose.mcap"
    with refused("runs.unknown", FileError, value="7", valid="0001-a, 0002-b, loose"):
        find("7", tmp_path)
    write_run(run, tmp_path / "0002-c.mcap")
    with refused("runs.ambiguous", FileError, value="2"):
        find("2", tmp_path)
    with refused("runs.folder-empty", FileError):
        find("last", tmp_path / "nowhere")


def test_a_recovered_run_replaces_its_damaged_run_in_the_list(run, tmp_path):
    first, cut = write_run(run, tmp_path / "0001-a.mcap"), tmp_path / "0002-b.mcap"
    cut.write_bytes(first.read_bytes()[:-300])
    recovered_file = recover(cut).path
    assert recovered_file == tmp_path / "0002-b-recovered.mcap"
    assert find("2", tmp_path) == find("0002", tmp_path) == find("last", tmp_path) == recovered_file
    assert find("0002-b", tmp_path) == cut
    for runs in ("1-2", "*", str(tmp_path), str(tmp_path / "0*.mcap")):
        assert find_all(runs, tmp_path) == [first, recovered_file]
    assert find_all(str(tmp_path / "*-b.mcap"), tmp_path) == [cut]
    third = write_run(run, tmp_path / "0002-c.mcap")
    with refused("runs.ambiguous", FileError, value="2", valid="0002-b-recovered, 0002-c"):
        find("2", tmp_path)
    assert find_all("2-2", tmp_path) == [recovered_file, third]


def test_the_list_has_one_line_for_each_intact_or_damaged_run(run, tmp_path):
    path = write_run(replace(run, metadata=run.metadata | {"verdict": "USABLE"}), tmp_path / "0001-a.mcap")
    (tmp_path / "0002-b.mcap").write_bytes(path.read_bytes()[:-300])
    (tmp_path / "0003-c.mcap").write_bytes(b"")
    worst = Event(int(run.t_ns[5]), "error", "loop", "the estimator raised")
    write_run(replace(run, events=(worst,)), tmp_path / "0004-d.mcap")
    rows = listing(tmp_path)
    assert [(r.number, r.name, r.kind, r.vehicle, r.verdict) for r in rows] == [
        (1, "0001-a", "experiment", "pequeño", "USABLE"),
        (2, "0002-b", "experiment", "pequeño", "USABLE"),
        (3, "0003-c", "?", "", "UNREADABLE"),
        (4, "0004-d", "experiment", "pequeño", ""),
    ]
    assert "was not closed" in rows[1].notes
    assert "is empty (0 bytes)" in rows[2].notes
    assert rows[3].notes == "the estimator raised"
    lines = listing_table(rows).splitlines()
    assert lines[0].split() == ["run", "kind", "duration", "vehicle", "verdict", "notes"]
    assert lines[1].split()[:5] == ["0001-a", "experiment", "2.0", "s", "pequeño"]
    plain = [row._replace(verdict="", notes="") for row in rows]
    assert listing_table(plain).splitlines()[0].split() == ["run", "kind", "duration", "vehicle"]
    assert listing_rows(rows)[2]["duration_s"] is None
    with refused("runs.no-folder", FileError):
        listing(tmp_path / "nowhere")


def test_show_counts_rates_gaps_and_events():
    t_ns = np.array([0, 10, 20, 50, 60, 70]) * 1_000_000
    z = np.array([[1.0], [np.nan], [2.0]])
    sensors = {"odo": Channel(t_ns[::2] - 3_000_000, t_ns[::2], z)}
    events = tuple(Event(int(t_ns[k % 6]), "warning", "supervisor", f"slow {k}") for k in range(25))
    listing = show(
        Run("0007-x", None, t_ns, np.zeros((6, 2)), sensors=sensors, events=events, metadata={"seed": "7"})
    )
    ticks, odometer = listing.rows()
    assert ticks == {
        "topic": "command applied", "count": 6, "size": 2, "rate_hz": pytest.approx(5 / 0.07), "gaps": 1,
        "longest_step_s": 0.03, "first_gap_s": 0.02, "nan_rows": 0,
    }  # fmt: skip
    assert (odometer["count"], odometer["nan_rows"], odometer["delay_ms"]) == (3, 1, pytest.approx(3.0))
    assert listing.verdict == "USABLE"
    text = listing.table()
    assert "0007-x: 6 ticks, 0.07 s. seed: 7" in text
    assert "71.43 Hz" in text
    assert "0.010 s  warning  supervisor: slow 1" in text
    assert "and 5 more events" in text
    assert len(listing.events()) == 25
    assert listing.events()[3]["t_s"] == 0.05


def test_show_lists_topics_and_the_notes_of_the_reader(run):
    topics = [row["topic"] for row in show(replace(run, notes=(note("run.vehicle-file-lost"),))).rows()]
    assert topics == [
        "command applied", "command requested", "command sent", "sensor imu", "sensor odometer", "estimate",
        "reference", "truth",
    ]  # fmt: skip
    listing = show(replace(run, notes=(note("run.vehicle-file-lost"),)))
    assert listing.verdict == "WARN"
    assert listing.table().endswith(sentence_of(note("run.vehicle-file-lost")))


def test_show_rounds_the_start_of_a_run(run):
    start = "0.0001351260208695354 -3.551184036010849e-06 0.0"
    shown_text = show(replace(run, metadata=run.metadata | {"start": start})).table()
    assert "start [m, rad]: 0.0001 0 0" in shown_text


def test_the_logs_of_a_run_print_the_shapes_of_their_arrays(run):
    for log in (run.truth, run.estimate, run.reference, run.sensors["imu"]):
        assert len(repr(log).splitlines()) == 1
    assert f"eta=array ({len(run.t_ns)}, 3), nu=" in repr(run.estimate)


def test_show_translates_the_names_and_numbers_of_the_metadata(run):
    metadata = {"machine": "Linux x86_64", "rest_s": "2.5"}
    with use_language("es"):
        shown_text = " ".join(show(replace(run, metadata=metadata)).table().split())
    assert "reposo antes del recorrido [s]: 2,5" in shown_text
    assert "machine" not in shown_text


def test_show_does_not_name_the_source_of_an_event_by_the_word_for_manual_driving(run):
    event = Event(int(run.t_ns[0]), "info", "drive", "it begins", None)
    with use_language("es"):
        assert f"{translate('drive')}:" not in show(replace(run, events=(event,))).table()


def test_the_brief_form_of_a_run_begins_its_events_with_the_error(run):
    start_ns = int(run.t_ns[0])
    events = [Event(start_ns + k, "info", "imu", f"line {k}", None) for k in range(5)]
    stop_event = Event(start_ns + 9, "error", "loop", "the estimator failed", None)
    brief = repr(replace(run, events=(*events, stop_event)))
    assert stop_event.text in brief


def test_show_aligns_its_columns_under_a_long_name(make_run):
    run = make_run()
    channels = {"temperature_of_the_gearbox": next(iter(run.sensors.values()))}
    _, _, head, *lines = (  # 'longest step' is divided, because the table is wider than 80 columns
        show(replace(run, sensors=run.sensors | channels, events=(), notes=())).table().splitlines()
    )
    ends = {line.index(" Hz") for line in lines}
    assert ends == {head.index("  gaps") - len(" Hz")}


def test_show_accepts_a_run_without_ticks(make_run):
    assert "0 ticks" in show(make_run(N=0)).table()


def test_a_csv_contains_exact_numbers_and_empty_cells_for_unknown_values(run, tmp_path):
    path = export_csv(replace(run, metadata={"commands": "u_x, u_y, u_psi"}), tmp_path / "x.csv")
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(run.t_ns)
    assert [float(row["applied.u_psi"]) for row in rows] == run.applied_commands[:, 2].tolist()
    assert [float(row["imu[2]"]) for row in rows] == run.sensors["imu"].z[:, 2].tolist()
    assert [row["odometer[0]"] != "" for row in rows[:7]] == [True, False, False, False, False, True, False]
    assert float(rows[0]["odometer.t_s"]) == -0.007
    assert {row["truth.nu_psi_dot_rad_s2"] for row in rows} == {""}
    assert float(rows[9]["estimate.std_psi_rad"] or "nan") == pytest.approx(
        run.estimate.cov[9, 2, 2] ** 0.5, nan_ok=True
    )


@pytest.mark.parametrize(
    ("vehicle_text", "metadata", "name"),
    [
        ('[command]\nnames = ["drive", "slip", "spin"]', {}, "drive"),
        ("", {"commands": "left, none, right"}, "left"),
        ('[command]\nnames = ["throttle"]', {}, "u[0]"),
        ("not = = toml", {}, "u[0]"),
    ],
)
def test_a_csv_names_the_commands_as_the_vehicle_file_or_the_map(run, tmp_path, vehicle_text, metadata, name):
    named_run = replace(run, vehicle_text=vehicle_text, metadata=metadata)
    header = export_csv(named_run, tmp_path / "x.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.split(",")[1] == f"applied.{name}"


def test_a_csv_for_spreadsheets_can_have_decimal_commas(run, tmp_path):
    text = export_csv(run.cut(0, 0.05), tmp_path / "x.csv", decimal=",").read_text(encoding="utf-8")
    assert text.splitlines()[0].startswith("t_s;applied.u[0];applied.u[1]")
    assert "." not in "".join(text.splitlines()[1:])
    with refused("runs.decimal", UsageError):
        export_csv(run, tmp_path / "y.csv", decimal=";")


def test_a_tum_file_has_full_time_and_heading(run, tmp_path):
    lines = export_tum(run, tmp_path / "x.tum", "truth").read_text(encoding="utf-8").splitlines()
    t, x, y, z, _, _, qz, qw = lines[1].split()
    assert t == f"{run.truth.t_ns[0] // 10**9}.{run.truth.t_ns[0] % 10**9:09d}"
    assert [float(x), float(y), float(z)] == [*run.truth.eta[0, :2], 0.0]
    assert 2 * np.arctan2(float(qz), float(qw)) == pytest.approx(run.truth.eta[0, 2])
    with refused("runs.file-exists", FileError):
        export_tum(run, tmp_path / "x.tum")
    with refused("runs.no-trajectory", UsageError, value="camera", trajectories="estimate, reference, truth"):
        export_tum(run, tmp_path / "y.tum", "camera")


def test_a_run_without_ticks_is_exported_as_a_header(run, tmp_path):
    no_rows = replace(
        run,
        t_ns=run.t_ns[:0],
        applied_commands=run.applied_commands[:0],
        requested_commands=None,
        sent_commands=None,
    )
    (head,) = export_csv(no_rows, tmp_path / "x.csv").read_text(encoding="utf-8").splitlines()
    assert "imu[0]" in head.split(",")


def test_a_diverged_heading_is_exported_as_nan(run, tmp_path):
    run.truth.eta[1, 2] = np.inf
    lines = export_tum(run, tmp_path / "x.tum", "truth").read_text(encoding="utf-8").splitlines()
    assert lines[2].split()[-2:] == ["nan", "nan"]
    assert len(lines) == 1 + len(run.truth.t_ns)


@pytest.fixture
def route():
    draw = np.random.default_rng(0).normal
    return Route(np.array([0.0, 0.1, 1 / 3]), draw(size=(3, 3)), draw(size=(3, 3)), True)


@pytest.mark.parametrize("is_closed", [True, False])
def test_a_route_written_and_read_back_is_the_same(route, is_closed, tmp_path):
    path = write_route(route._replace(closed=is_closed), tmp_path / "laboratorio ñ" / "lap.csv")
    write_route(route._replace(closed=is_closed), path)  # a newer file replaces it
    read_back = read_route(path)
    assert all(np.array_equal(a, b) for a, b in zip(read_back, route._replace(closed=is_closed), strict=True))
    assert read_back.closed is is_closed
    assert [p.name for p in path.parent.iterdir()] == ["lap.csv"]


def test_a_route_from_a_spreadsheet_is_read(route, tmp_path):
    path = write_route(route, tmp_path / "lap.csv")
    text = path.read_text(encoding="utf-8").replace(",", ";").replace(".", ",")
    path.write_text(text, encoding="utf-8-sig")
    assert np.array_equal(read_route(path).eta, route.eta)


def test_a_route_of_one_row_is_refused(route, tmp_path):
    path = write_route(Route(*(a[:1] for a in route[:3]), False), tmp_path / "lap.csv")
    with refused("route.too-short", FileError, count=1):
        read_route(path)
