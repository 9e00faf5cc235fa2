"""The text of a CSV file: a plain format is detected, and an ambiguous format is refused."""

import gzip
import json
import re

import numpy as np
import pytest
from hypothesis import given, strategies as st

from baqueano.errors import FileError
from baqueano.runs import import_run
from baqueano.runs.tables.table import LogTable
from tests.codes import includes, refused


@pytest.mark.parametrize(
    "format",
    [
        {"sep": ";"},
        {"sep": "\t"},
        {"sep": ";", "decimal": ","},
        {"sep": "\t", "decimal": ","},
        {"encoding": "utf-8-sig"},
        {"encoding": "utf-16"},
    ],
)
def test_lg9_plain_csv_formats_are_detected_automatically(lab, format):
    assert lab.run(**format).run == lab.run().run


def test_gzip_spaces_comments_and_quotes_are_read(lab):
    run = lab.run().run
    path = lab.folder / "board.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[0] = ",".join(f'"{name}"' for name in lines[0].split(","))
    text = "# from the lab\r\n\r\n" + " \r\n".join(lines)
    path.write_bytes(gzip.compress(text.encode()))
    assert import_run(lab.folder / "lab.toml").run == run


@pytest.mark.parametrize("format", [{"sep": ";", "decimal": ","}, {"sep": "\t"}, {}])
def test_the_first_line_of_excel_names_the_separator(lab, format):
    run = lab.run(**format).run
    path = lab.folder / "board.csv"
    path.write_text(f"sep={format.get('sep', ',')}\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    assert import_run(lab.folder / "lab.toml").run == run


def raw(lab, text, encoding="utf-8"):
    """Return the refusal of a board file with this text."""
    lab.save()
    (lab.folder / "board.csv").write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
    with pytest.raises(FileError) as error_info:
        import_run(lab.folder / "lab.toml")
    return error_info.value.diagnostic


HEAD = "t,throttle,steer,ax,ay,wz,speed\n"
SEMI = HEAD.replace(",", ";")


def rows(last, sep=","):
    """Return three rows that end with this cell."""
    return "".join(sep.join([f"{k}", "0", "0", "0", "0", "0", last]) + "\n" for k in range(3))


@pytest.mark.parametrize(
    ("text", "code", "figures"),
    [
        (b"", "table.empty", {}),
        ("\n# nothing\n", "table.no-data", {}),
        ("1,2,3\n4,5,6\n", "table.no-header", {"value": "1, 2, 3"}),
        (
            HEAD + "0,0,0,0,0,0,0\n1,2\n2,0,0,0,0,0,0\n",
            "table.uneven",
            {"line": 3, "value": 2, "expected": 7},
        ),
        (HEAD + rows("0,5"), "table.commas-between-commas", {"line": 2}),
        (HEAD + rows("fast"), "table.word", {"line": 2, "column": "speed", "value": "fast"}),
        (HEAD + rows("1_000"), "table.not-number", {"column": "speed", "value": "1_000"}),
        (HEAD + rows("١"), "table.not-number", {"column": "speed", "value": "١"}),
        (HEAD + rows('"1,5"'), "table.comma-of-number", {"column": "speed", "value": "1,5"}),
        (SEMI + "0;0;0;0;0;0;1,5\n1;0;0;0;0;0;2.5\n", "table.two-decimals", {"value": "1,5"}),
        (SEMI + rows("1.234,5", ";"), "table.two-decimals", {"value": "1.234,5"}),
        (
            SEMI + rows("1,234", ";"),
            "table.comma",
            {"value": "1,234", "integer_reading": "1234", "decimal_reading": "1.234"},
        ),
        ("t;throttle,a\n0;1,2\n", "table.delimiter", {"delimiters": "commas or semicolons"}),
        (HEAD.replace("throttle", "speed") + rows("0"), "table.column-twice", {"column": "speed"}),
        (
            HEAD.replace("speed", "Speed [m/s]") + rows("0"),
            "table.column-mistyped",
            {"column": "speed", "match": "'steer', 'Speed [m/s]'"},
        ),
        (b"\xff\xfet,\xd8", "table.not-encoded", {"encoding": "utf-16"}),
        ("t,señal\n0,0\n".encode("cp1252"), "table.not-encoded", {"encoding": "utf-8-sig"}),
        (HEAD.encode("utf-16-le"), "table.utf-16", {"encoding": "utf-16-le"}),
        (HEAD.encode("utf-16-be"), "table.utf-16", {"encoding": "utf-16-be"}),
        (b"\x01\x02" * 900 + b"\0abc" * 40, "table.zero-bytes", {}),
        (b"\x1f\x8b\x08abcdefgh", "table.gzip", {}),
        (HEAD + '0,0,0,0,0,0,"a\n' + rows("0"), "table.not-csv", {"line": 2}),  # the rest is inside the quote
        (HEAD + '0,0,0,0,"a,0,0\n' + rows("0"), "table.not-csv", {"line": 2}),
        (HEAD, "import.no-rows", {}),
        (HEAD + "0,0,0,0,0,0,0\n", "import.too-short", {"rows": 1, "minimum": 3}),
    ],
)
def test_lg9_an_ambiguous_or_wrong_csv_is_refused_with_a_remedy(lab, text, code, figures):
    reason = raw(lab, text)
    assert (reason.code, {name: reason.figures[name] for name in figures}) == (code, figures)
    assert "board.csv" in reason.figures.values()


def model_values(cells):
    """Return the values read from a column of these cells, or the refusal of its first invalid cell."""
    table = LogTable("log.csv", {"v": cells}, np.arange(2, 2 + len(cells)))
    try:
        return table.numbers("v").tolist()
    except FileError as refusal:
        return str(refusal)


@given(
    st.lists(
        st.text("0123456789+-.eE", max_size=6) | st.floats(allow_nan=False).map(repr), min_size=1, max_size=4
    )
)
def test_reading_a_whole_column_gives_the_same_as_reading_each_cell(cells):
    at_once, slowly = model_values(cells), model_values([*cells, "true"])  # a word: each cell is examined
    assert repr(at_once) == repr(slowly if isinstance(slowly, str) else slowly[:-1])


def test_a_point_between_decimal_commas_is_not_guessed():
    with refused("table.not-number", FileError, value="1.234"):
        LogTable("log.csv", {"v": ["0,5", "1.234"]}, np.arange(2), ",").numbers("v")


@pytest.mark.parametrize("cell", ["1_000", "١", "+-3", "1e", ".", "0x10", "1 2"])
def test_unusual_python_number_formats_are_refused(cell):
    assert "line 3, column 'v'" in model_values(["1", cell])


@pytest.mark.parametrize(
    ("cells", "values"),
    [
        (["1", "-2", "+3", "007"], [1, -2, 3, 7]),
        (["9223372036854775807"], [2**63 - 1]),
        (["9223372036854775808"], None),
        (["+-3"], None),
        (["1", ""], None),
        (["1.0"], None),
        (["١"], None),
    ],
)
def test_integers_are_read_exactly_or_refused(cells, values):
    numbers = LogTable("log.csv", {"t": cells}, np.arange(len(cells))).integers("t")
    assert (None if numbers is None else numbers.tolist()) == values


def test_the_csv_format_in_the_map_is_applied(lab):
    lab.board["speed"] = np.round(lab.board["speed"], 3)
    text = "t;speed\n" + "\n".join(
        f"{t:.3f};{v:.3f}".replace(".", ",")
        for t, v in zip(*(lab.board[c] for c in ("t", "speed")), strict=True)
    )
    lab.camera["t"] = lab.camera["t"] + 0.0
    lab.edit(
        '[sensors.odometer]\nfile = "board"',
        '[files.wheel]\npath = "wheel.csv"\ntime = "t"\ntime_unit = "s"\n[sensors.odometer]\nfile = "wheel"',
    )
    lab.save()
    (lab.folder / "wheel.csv").write_text(text, encoding="utf-8")
    zeros_first = import_run(lab.folder / "lab.toml").run.sensors["odometer"].z[:, 0]
    assert zeros_first == pytest.approx(lab.board["speed"])  # "0,000" cannot be a thousand
    lab.edit('path = "wheel.csv"', 'path = "wheel.csv"\ndecimal = ","')
    (lab.folder / "lab.toml").write_text(lab.map, encoding="utf-8")
    assert import_run(lab.folder / "lab.toml").run.sensors["odometer"].z[:, 0] == pytest.approx(
        lab.board["speed"]
    )


def test_tags_and_compass_are_converted_to_si_and_angles_are_wrapped(lab):
    lab.board["deg"], lab.board["x_mm"] = lab.board["t"] + 179.9, 1e3 * lab.board["t"]
    lab.map += """
[sensors.compass]
file = "board"
z = [{ column = "deg", unit = "deg" }]

[sensors.tags]
file = "board"
z = [{ column = "x_mm", unit = "mm" }, { column = "t", unit = "m" }]
"""
    sensors = lab.run().run.sensors
    angle = np.unwrap(sensors["compass"].z[:, 0])
    assert np.all(np.abs(sensors["compass"].z) <= np.pi)
    assert angle == pytest.approx(np.radians(lab.board["deg"]))
    assert sensors["tags"].z[:, 0] == pytest.approx(sensors["tags"].z[:, 1])


def test_columns_without_names_are_addressed_by_number(lab):
    lab.save()
    path = lab.folder / "board.csv"
    path.write_text(path.read_text(encoding="utf-8").split("\n", 1)[1], encoding="utf-8")
    text = lab.map.replace('path = "board.csv"\ntime = "t"', 'path = "board.csv"\nheader = false\ntime = "1"')
    for number, name in enumerate(lab.board, 1):
        text = text.replace(f'column = "{name}"', f'column = "{number}"')
    (lab.folder / "lab.toml").write_text(text, encoding="utf-8")
    run = lab.fresh().run
    imported_run = import_run(lab.folder / "lab.toml").run
    assert imported_run.sensors["imu"].z.tobytes() == run().run.sensors["imu"].z.tobytes()


def test_a_separator_at_the_end_of_each_row_does_not_add_a_column(lab):
    run = lab.run().run
    path = lab.folder / "board.csv"
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([head, *(f"{line}," for line in lines)]) + "\n", encoding="utf-8")
    assert import_run(lab.folder / "lab.toml").run == run


@pytest.mark.parametrize("last_line", ["30.0,3,0.1", '30.0,3,0.1,0,0,0,0,"0.'])
def test_an_incomplete_last_line_is_ignored_and_reported(lab, last_line):
    lab.save()
    path = lab.folder / "board.csv"
    path.write_text(path.read_text(encoding="utf-8") + last_line, encoding="utf-8")
    run, findings = import_run(lab.folder / "lab.toml")
    assert includes(findings[0].reason, "recording.cut-line", table="board.csv", line=1502)
    assert len(run.sensors["imu"].t_ns) == 1500


@pytest.mark.parametrize("name", ["speed", "Speed of it"])
def test_the_proposed_map_entry_skips_a_row_of_units(lab, name):
    run = lab.run().run
    path = lab.folder / "board.csv"
    head, *lines = path.read_text(encoding="utf-8").replace("speed", name).splitlines()
    path.write_text("\n".join([head, "s,-,-,-,-,-,-,m/s", *lines]) + "\n", encoding="utf-8")
    text = lab.map.replace('column = "speed"', f'column = "{name}"')
    text = text.replace('path = "board.csv"', 'path = "board.csv"\nwhere = { }')
    map_file = lab.folder / "commented.toml"
    map_file.write_text(text, encoding="utf-8")
    with refused("table.word", FileError, column="t", value="s", key="t", line=2) as error_info:
        import_run(map_file)
    (line,) = re.findall(r"exclude the row with (where = .*)\.$", str(error_info.value))
    map_file.write_text(text.replace("where = { }", line), encoding="utf-8")
    assert import_run(map_file).run.applied_commands.tobytes() == run.applied_commands.tobytes()
    table = LogTable("log.csv", {name: ["m/s", "1"]}, np.arange(2))
    with pytest.raises(FileError) as error_info:
        table.numbers(name)
    key = name if name == "speed" else f'"{name}"'
    assert str(error_info.value).endswith(f'where = {{ {key} = {{ not = "m/s" }} }}.')


def as_json_lines(path, of_cell=float):
    head, *rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    return [json.dumps({name: of_cell(cell) for name, cell in zip(head, row, strict=True)}) for row in rows]


def test_json_lines_are_read_as_a_table_of_their_flattened_names(lab):
    table_run = lab.run().run
    lines = [json.loads(line) for line in as_json_lines(lab.folder / "board.csv")]
    nested_rows = [
        {"t": x["t"], "id": x["id"], "cmd": [x["throttle"], x["steer"]], "speed": x["speed"],
         "imu": {"a": [x["ax"], x["ay"]], "wz": x["wz"]}} for x in lines
    ]  # fmt: skip
    path = lab.folder / "board.csv"
    path.write_text("\n".join(map(json.dumps, nested_rows)) + '\n{"t": 29.9', encoding="utf-8")
    text = (lab.folder / "lab.toml").read_text(encoding="utf-8")
    names = {"throttle": "cmd.0", "steer": "cmd.1", "ax": "imu.a.0", "ay": "imu.a.1", "wz": "imu.wz"}
    for name, flat in names.items():
        text = text.replace(f'column = "{name}"', f'column = "{flat}"')
    (lab.folder / "lab.toml").write_text(text, encoding="utf-8")
    run, findings = import_run(lab.folder / "lab.toml")
    assert np.array_equal(run.applied_commands, table_run.applied_commands)
    assert all(np.array_equal(run.sensors[name].z, table_run.sensors[name].z) for name in table_run.sensors)
    assert [finding.reason.code for finding in findings][:1] == ["recording.cut-line"]


def test_json_lines_of_topics_are_one_table_with_empty_cells(lab):
    table_run = lab.run().run
    topics = []
    for line in as_json_lines(lab.folder / "board.csv"):
        row = json.loads(line)
        imu = {name: row.pop(name) for name in ("ax", "ay", "wz")}
        topics += [json.dumps(row), json.dumps({"t": row["t"]} | imu)]
    (lab.folder / "board.csv").write_text("\n".join(topics), encoding="utf-8")
    run, findings = import_run(lab.folder / "lab.toml")
    assert np.array_equal(run.sensors["imu"].z, table_run.sensors["imu"].z)
    assert "recording.joined" in {finding.reason.code for finding in findings}


def test_a_line_that_is_not_json_is_named(lab):
    diagnostic = raw(lab, '{"t": 0, "throttle": 1}\n{"t": 1, throttle: 1}\n{"t": 2, "throttle": 1}\n')
    assert (diagnostic.code, diagnostic.figures["line"]) == ("table.not-json", 2)
