"""`baqueano route`: each command stores a route that the next command accepts; an impossible route is refused before a
drive."""

import shlex

import numpy as np
import pytest

from baqueano.cli.driving.route import fastest_route
from baqueano.errors import AnswerNo
from baqueano.guides.shapes import circle
from baqueano.messages import text
from baqueano.messages.language import use_language
from baqueano.messages.notation import COMMAND_LINE, use_notation
from baqueano.routes import at_speed
from baqueano.vehicle_file import load


@pytest.fixture
def lab(baqueano, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert baqueano("route", "draw", "eight", "lab", "--size", "0.6").code == 0
    return baqueano


def stored_routes(baqueano):
    return [row["route"] for row in baqueano("route", "ls", "--json").reply["rows"]]


def test_each_route_command_stores_a_new_route(lab):
    for verb, *options in (
        ("smooth", "--rms", "0.02"), ("cut", "--from", "0.5", "--to", "1.5"), ("reverse",), ("scale", "2"),
        ("faster", "--vehicle", "small"), ("faster", "--speed", "0.3"), ("join", "lab", "-o", "twice"),
    ):  # fmt: skip
        end = lab("route", verb, "lab", *options, "--json")
        assert end.code == 0, end.err
    assert stored_routes(lab) == sorted(
        ["lab", "lab-cut", "lab-fast", "lab-reverse", "lab-scale", "lab-smooth", "lab-speed", "twice"]
    )
    rows = {row["route"]: row for row in lab("route", "ls", "--json").reply["rows"]}
    assert rows["lab-scale"]["length_m"] == pytest.approx(2.0 * rows["lab"]["length_m"], rel=1e-6)
    assert rows["lab-fast"]["duration_s"] < rows["lab"]["duration_s"]
    assert lab("route", "check", "lab-fast", "--vehicle", "small", "--room", "2x2").code == 0


def test_an_edit_that_gives_a_refused_route_advises_to_cut_it_and_not_to_drive_it(lab, tmp_path):
    lines = (tmp_path / "routes" / "lab.csv").read_text(encoding="utf-8").splitlines()
    lines[100] = ",".join(["%.6f" % (float(x) + 3.0 * (k == 1)) for k, x in enumerate(lines[100].split(","))])
    (tmp_path / "routes" / "jump.csv").write_text("\n".join(lines), encoding="utf-8")
    end = lab("route", "reverse", "jump")
    assert "baqueano route cut jump-reverse" in end.out + end.err
    assert "baqueano repeat" not in end.err
    assert "jump-reverse.csv" in end.err


def test_a_damaged_route_does_not_hide_the_others(lab, tmp_path):
    (tmp_path / "routes" / "box.csv").write_text("x,y\n0,0\n1,1\n", encoding="utf-8")
    end = lab("route", "ls")
    assert (end.code, end.out.split()[0]) == (0, "lab")
    assert "box.csv" in end.err


def test_spreadsheet_points_are_converted_to_a_route(lab, tmp_path):
    (tmp_path / "points.csv").write_text("x;y\n0;0\n1,5;0\n1,5;1\n0;1\n0;0\n", encoding="utf-8")
    end = lab("route", "import", "points.csv", "box", "--json")
    assert end.code == 0, end.err
    (row,) = end.reply["rows"]
    assert row["closed"]
    assert row["length_m"] == pytest.approx(5.0, abs=0.3)


def test_points_below_a_metre_in_millimetres_with_decimal_commas_are_converted_to_a_route(lab, tmp_path):
    rows = [f"{0.01 * k:.3f};{0.002 * k:.3f}" for k in range(100)]
    (tmp_path / "points.csv").write_text("x;y\n" + "\n".join(rows).replace(".", ","), encoding="utf-8")
    (row,) = lab("route", "import", "points.csv", "line", "--json").reply["rows"]
    assert row["length_m"] == pytest.approx(0.99 * np.hypot(1.0, 0.2), abs=0.02)


def test_an_import_names_the_columns_that_it_does_not_use(lab, tmp_path):
    """Before, an import of poses with speeds and waits ignored both without a message."""
    (tmp_path / "points.csv").write_text(
        "s_m,x_m,y_m,v_m_s,wait_s\n0,0,0,0.1,0\n1,1,0,0.1,2\n", encoding="utf-8"
    )
    end = lab("route", "import", "points.csv", "line")
    assert end.code == 0
    assert "s_m, v_m_s, wait_s" in end.out + end.err


def test_a_run_is_converted_to_a_route(lab):
    assert lab("repeat", "lab", "--vehicle", "small").code == 0
    assert lab("route", "import", "last", "again", "--json").reply["rows"][0]["closed"]


def error_cause(reason):
    """Return the code of a refusal; the table of `route check` contains it, and its error refers to the table."""
    return reason.figures["cause"].code if reason.code == "cli.route-refused" else reason.code


@pytest.mark.parametrize("verb", ["check", "repeat"])
def test_an_excessive_speed_is_refused_with_a_command(lab, verb):
    assert lab("route", "faster", "lab", "--speed", "3").code == 0
    end = lab("route", "check", "lab-speed", "--vehicle", "small") if verb == "check" else lab(
        "repeat", "lab-speed", "--vehicle", "small"
    )  # fmt: skip
    assert end.code == AnswerNo.exit_code
    assert error_cause(end.reason) == "route.speed-too-high"
    assert end.fix == "baqueano route faster lab-speed"
    line = (verb,) if verb == "repeat" else ("route", "check")
    end = lab(*line, "lab", "--vehicle", "small", "--room", "1x1")
    assert error_cause(end.reason) == "route.through-wall"
    assert end.fix == "baqueano route scale lab 0.78"
    with use_notation(COMMAND_LINE):
        sentence = text(end.reason.figures.get("cause", end.reason))
    assert (end.out + end.err).count(sentence) == 1


def test_the_advised_route_command_solves_the_problem(lab):
    lab("route", "faster", "lab", "--speed", "3")
    assert lab("route", "faster", "lab-speed", "--vehicle", "small").code == 0
    assert lab("repeat", "lab-speed-fast", "--vehicle", "small").code == 0


def test_the_highest_speeds_are_not_called_faster_if_the_route_takes_longer(monkeypatch):
    messages, shape, file = [], circle(0.5, 0.2), load("small")
    monkeypatch.setattr("baqueano.cli.driving.route.print_message", messages.append)
    fastest_route(at_speed(shape, 0.05), "lab", file)
    assert messages == []
    result = fastest_route(at_speed(shape, 3.0), "lab", file, command_share=0.5)
    (message,) = messages
    assert message.code == "cli.route-slower"
    assert (message.figures["duration_s"], message.figures["percent"]) == (result.t_s[-1], 50.0)


def test_the_advised_command_quotes_the_name_and_lets_two_routes_join(lab):
    lab("route", "reverse", "lab", "--backing", "-o", "my back")
    lab("route", "cut", "lab", "--to", "1", "-o", "my way")
    end = lab("route", "join", "my way", "my back")
    assert end.reason.code == "route.join-reverses"
    _, *words = shlex.split(end.fix)
    assert lab(*words, "-o", "turned").code == 0
    assert lab("route", "join", "turned", "my back").code == 0


def test_the_force_option_permits_a_fast_route(lab, tmp_path):
    lab("route", "faster", "lab", "--speed", "0.6")
    line = "repeat", "lab-speed", "--vehicle", "small"
    assert lab(*line).code == AnswerNo.exit_code
    assert not list((tmp_path / "runs").glob("*.mcap"))
    lab(*line, "--force")
    assert len(list((tmp_path / "runs").glob("*-repeat.mcap"))) == 1


@pytest.mark.parametrize(
    ("code", "line"),
    {
        "route.absent": ("smooth", "nowhere"),
        "route.absent-stored": ("smooth", "labb"),
        "route.absent-shape": ("smooth", "eigth"),
        "shape.unknown": ("draw", "eigth", "lab"),
        "cli.two-tolerances": ("smooth", "lab", "--rms", "0.01", "--max", "0.02"),
        "cli.start-without-room": ("check", "lab", "--vehicle", "small", "--start", "1,0,0"),
        "cli.start-unreadable": ("check", "lab", "--vehicle", "small", "--room", "2x2", "--start", "left"),
        "cli.points-absent": ("import", "nowhere.csv", "box"),
        "route.cut": ("cut", "lab", "--from", "3", "--to", "9"),
        "route.columns": ("import", "routes/wrong.csv", "box"),
    }.items(),
)
def test_bad_route_input_gives_an_error_of_one_paragraph(lab, tmp_path, code, line):
    (tmp_path / "routes" / "wrong.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    end = lab("route", *line)
    assert end.code != 0
    assert end.reason.code == code


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("x,y\n0,0\n1,fast\n", "route.cell"),
        ("x,y\n0,0\n1,1_000\n", "route.cell"),
        ('x,y\n0,0\n1,"1,5"\n', "route.comma-of-number"),
        ("x;y\n1,000;2,000\n3,000;4,000\n", "route.comma"),
        ("x,y;z\n0,1;2\n", "route.delimiter"),
        ("0,0\n1,1\n", "route.no-header"),
        ("x,y\n0,0\n1,1,1\n", "route.uneven"),
        ("x,y\n0\n1\n2,1\n", "route.uneven"),
        ("x,y,señal\n0,0,0\n".encode("cp1252"), "route.encoding"),
        ("x,y\n0,0\n".encode("utf-16-le"), "route.encoding"),
    ],
)
def test_the_advice_for_unclear_points_can_be_used_without_a_map(lab, tmp_path, content, code):
    (tmp_path / "points.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    end = lab("route", "import", "points.csv", "box")
    assert (end.code, end.reason.code) == (3, code)
    for language in ("en", "es"):
        with use_language(language):
            sentence = text(end.reason)
        assert not any(
            key in sentence for key in ("[files", "where =", "header =", "decimal =", "encoding =")
        )


def test_a_refused_route_has_a_page_with_its_path_in_the_room(lab, tmp_path):
    files = ("--report", "lab.html", "--figures", "figures")
    assert lab("route", "check", "lab", "--vehicle", "small", "--room", "1x2", *files).code == 1
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == ["01-path.svg", "02-demands.svg"]
    assert "<svg" in (tmp_path / "lab.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("route", ["my side", "routes/my side.csv"])
def test_the_headings_of_a_sideways_route_are_taken_from_its_path(lab, tmp_path, route):
    lab("route", "draw", "line", "way")
    head, *rows = (tmp_path / "routes" / "way.csv").read_text().splitlines()[1:]
    psi = head.split(",").index("psi_rad")
    turned_lines = [",".join([*(row := line.split(","))[:psi], "1.5708", *row[psi + 1 :]]) for line in rows]
    side = tmp_path / "routes" / "my side.csv"
    side.write_text("\n".join(["# closed = false", head, *turned_lines]), encoding="utf-8")
    end = lab("route", "check", route, "--vehicle", "small")
    assert error_cause(end.reason) == "route.sideways"
    assert lab(*shlex.split(end.fix)[1:]).code == 0
    assert lab("route", "check", "my side-turned", "--vehicle", "small").code == 0


def test_a_single_fast_lap_begins_at_rest(lab):
    """Before, the reference began at 2.4 m/s, and the car was up to 0.65 m beside its route by its estimate."""
    lab("route", "draw", "circle", "round", "--size", "3", "--speed", "0.5")
    end = lab("repeat", "round", "--vehicle", "car", "--faster", "--json")
    assert end.reply["rows"][0]["across_estimate_max_m"] < 0.05
