"""All output of a command passes through gettext: with a catalogue of strange letters, untranslated English words are
detected. Names, keys and command lines are not translated."""

import gettext
import html
import re
from copy import copy
from pathlib import Path

import click
import pytest

from baqueano.cli import baqueano, main
from baqueano.cli.subcommands import SUBCOMMANDS as ALL, load_command, translate_command
from baqueano.messages import english_text, language
from baqueano.runs import read_run

ENGLISH = (
    "the|of|and|with|without|from|to|is|are|was|were|not|by|its|it|than|for|at|in|on|no|error|speed|laps?|heading|run|"
    "estimate|truth|noise|gain|value|unit|position|velocity|time|held|within|mean|limit|wheel|command|covariance|parameter|"
    "verdict|topic|count|rate|gaps|longest|size|drift|distance|duration|expected|warning|yes|consistent|cost"
)
WORD = re.compile(rf"(?<![\w./\\\-'\"=\[:<])({ENGLISH})(?![\w./\\\-'\"=\]:(])", re.IGNORECASE)
CODE = re.compile(
    r"^  laps {2,}|COMMAND \[ARGS\]|"
    r"baqueano \d[^\n]*|baqueano [a-z][^.;,:\n]*(\.[a-z]+[^.;,:\n]*)*|--[\w-]+( \S+)?|\[[\w. ]+\]"
)
INFINITIVE = re.compile(r"\w+(ar|er|ir)(lo|la|los|las)?\b")
OTHER_DEFAULT = re.compile(r"\b(si falta|por defecto|por omisión|de manera predeterminada)\b", re.IGNORECASE)
TUTEO = re.compile(r"\b(tú|dale|tienes|puedes|quieres|tu|tus|tenés|podés)\b", re.IGNORECASE)
FIELD = re.compile(r"(\{(?:[^{}]|\{[^{}]*\})*\}|%\([^)]*\)[a-z]|%[std])")
POINT = re.compile(r"(?<![\w./=-])\d+\.\d+(?![\w.]*[./]\w)(?!\w)")
STRANGE = str.maketrans("abcdefghijklmnopqrstuvwxyz", "αвɔđєƒɢнιʝκʟмиσρφяѕτυνωχуζ")
SUBCOMMANDS = [
    "--help",
    "runs ls",
    "runs show 1",
    "compare 1",
    "identify 1 --vehicle small --free model.friction.linear[0] --no-noise",
    "forecast lab --vehicle small --laps 2",
    "replay 1 --vehicle small -o again.mcap",
    "simulate --vehicle small --seconds 0.3 -o tiny.mcap",
    "blocks ls --vehicle small",
    "blocks check imu",
    "runs import w.toml log.csv -o imported.mcap",
    "runs show cut.mcap",
    "runs recover cut.mcap",
    "runs noise 1",
    "runs wear 1 2",
    "runs cut 1 --from 0 --to 2",
    "runs export 1 --to csv",
    "tune --vehicle small --route lab --help",
    "study first-drives --seeds 1",
    "robot doctor",
    "robot settings",
    "runs import log.csv",
    "new project --vehicle small",
    "serve --help",
    "drive --help",
    "robot settings --help",
    "compare nothing",
    "study --help",
    "runs show nothing",
    "identify 1 --vehicle small --set model.mass_kg=heavy",
]
MAP = """format = 1
name = "w"
[files.log]
time = "t_ms"
time_unit = "ms"
[command]
in_force = "from"
wheels = [{ column = "left", unit = "raw", scale = 0.0039 }, { column = "right", unit = "raw", scale = 0.0039 }]
[sensors.imu]
z = [{ column = "ax", unit = "m/s^2" }, { column = "ay", unit = "m/s^2" }, { column = "gyro", unit = "rad/s" }]
"""


def strange(words: str) -> str:
    """Return a template in letters of no language, its fields as they are.

    >>> strange("{laps} laps")
    '{laps} ʟαρѕ'
    """
    parts = FIELD.split(words)
    return "".join(part if k % 2 else part.translate(STRANGE) for k, part in enumerate(parts))


@pytest.fixture
def in_strange_letters(monkeypatch):
    """Make `--lang es` print a catalogue in letters of no language."""
    real = gettext.translation(language.DOMAIN, language.CATALOGUES, ["es"])
    command_copy = copy(real)
    command_copy._catalog = {  # pyright: ignore[reportAttributeAccessIssue]
        key: strange(key.rpartition("\4")[2]) for key in real._catalog if isinstance(key, str) and key
    }
    monkeypatch.setattr(language, "_catalogue", lambda name: command_copy)


@pytest.fixture(autouse=True)
def _language_of_the_tests():
    """Cancel the language that a command line with `--lang es` chose for this process."""
    yield
    language.choose_language("")


def words_of(command: click.Command) -> list[str]:
    """Return the help of a command and of its options."""
    return [
        command.help or "",
        *(param.help or "" for param in command.params if isinstance(param, click.Option)),
    ]


def printed_by(line: str, capsys) -> str:
    """Return both output streams of a command."""
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["--lang", "es", *line.split()])
    out, err = capsys.readouterr()
    return out + err


def english_in(text: str) -> list[str]:
    """Return the lines that contain English words outside of command lines, names and keys."""
    return [line for line in text.splitlines() if WORD.search(CODE.sub("", line))]


@pytest.fixture
def in_lab(lab: Path, tmp_path: Path, monkeypatch) -> None:
    """Return a separate folder with the runs and the route of the lab."""
    for path in lab.rglob("*"):
        target = tmp_path / path.relative_to(lab)
        target.mkdir(exist_ok=True) if path.is_dir() else target.write_bytes(path.read_bytes())
    first = next((tmp_path / "runs").glob("0001*")).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(first[: 2 * len(first) // 3])
    rows = (f"{20 * k},{k % 50 * 5},{k % 37 * 6},{k % 7},{k % 5},{k % 11 * 3}" for k in range(400))
    (tmp_path / "log.csv").write_text("t_ms,left,right,ax,ay,gyro\n" + "\n".join(rows), encoding="utf-8")
    (tmp_path / "w.toml").write_text(MAP, encoding="utf-8")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("line", SUBCOMMANDS)
def test_a_command_prints_no_english_with_a_translation(line, in_lab, in_strange_letters, capsys):
    assert not english_in(printed_by(line, capsys))


def test_help_is_translated_after_an_earlier_english_call(in_strange_letters, capsys):
    with pytest.raises(SystemExit):
        main(["tune", "--help"])
    assert not english_in(printed_by("tune --help", capsys))


def helps():
    """Yield each command that has a help, with the text of this help."""
    commands = [("baqueano", baqueano), *((name, load_command(name)) for name in ALL)]
    for name, command in commands:
        yield name, command
        for x, verb in getattr(command, "commands", {}).items():
            yield f"{name} {x}", verb


@pytest.mark.parametrize("name", language.LANGUAGES)
def test_each_help_fits_80_columns_and_names_its_defaults_as_they_are_typed(name):
    language.choose_language(name)
    pages = [
        translate_command(command).get_help(click.Context(command, terminal_width=80, max_content_width=80))
        for _, command in helps()
    ]
    lines = [line for page in pages for line in page.split("\n")]
    assert [line for line in lines if len(line) > 80] == []
    assert not re.search(r"(default|predeterminad[oa]): \(", "\n".join(pages))


def test_each_option_has_a_help_text():
    silent = [
        f"{name} {param.opts[0]}"
        for name, command in helps()
        for param in command.params
        if isinstance(param, click.Option) and len((param.help or "").split()) < 2
    ]
    assert silent == []


def test_spanish_help_uses_the_third_person_and_one_default_wording():
    language.choose_language("es")
    wordings = [
        (name, wording) for name, command in helps() for wording in words_of(translate_command(command))
    ]
    assert len(wordings) > 250
    assert [wording for wording in wordings if INFINITIVE.match(wording[1])] == [], "Guarda, not Guardar"
    assert [wording for wording in wordings if OTHER_DEFAULT.search(wording[1])] == [], "predeterminado"
    assert [wording for wording in wordings if TUTEO.search(wording[1])] == [], "usted"


def test_the_names_of_values_are_spanish(capsys):
    help_text = (
        printed_by("report --help", capsys)
        + printed_by("runs --help", capsys)
        + printed_by("repeat --help", capsys)
    )
    assert "-o, --out ARCHIVO" in help_text
    assert "COMANDO [ARGUMENTOS]..." in help_text
    assert not re.findall(r"\b(TEXT|INTEGER RANGE|PATH|COMMAND|OPTIONS)\b", help_text)


def test_comments_of_map_drafts_and_new_projects_are_in_spanish(in_lab, capsys):
    Path("odd.csv").write_text("a,b\n1,2\n3,4\n5,6\n", encoding="utf-8")
    printed_by("runs import odd.csv --draft odd.toml", capsys)
    printed_by("new car --vehicle car", capsys)
    printed_by("new small --vehicle small", capsys)
    assert "ninguna columna parece un comando" in Path("odd.toml").read_text(encoding="utf-8")
    for name in ("car", "small"):
        comments = re.findall(r"#.*", Path(name, "vehicle.toml").read_text(encoding="utf-8"))
        assert len(comments) > 10
        assert [comment for comment in comments if WORD.search(comment.partition(":")[0])] == []


def test_a_spanish_report_contains_no_english(in_lab, in_strange_letters, capsys):
    printed_by("report 2 -o page.html", capsys)
    page = Path("page.html").read_text(encoding="utf-8")
    body = re.sub(
        r"<style.*?</style>|<code>.*?</code>|<metadata>.*?</metadata>|<defs>.*?</defs>", "", page, flags=re.S
    )
    words = html.unescape("\n".join(re.findall(r">([^<>]+)<", body)))
    assert '<html lang="es">' in page
    assert not english_in(words)


@pytest.mark.parametrize(
    "line", ["compare 1", "runs ls", "route ls", "forecast lab --vehicle small --laps 1", "route check lab"]
)
def test_numbers_have_a_decimal_comma(line, in_lab, capsys):
    figures_text = CODE.sub("", printed_by(line, capsys))
    assert not POINT.findall(figures_text)
    assert re.search(r"\d,\d", figures_text) or "forecast" in line


def test_files_and_json_retain_decimal_points_and_english(in_lab, capsys):
    reply = printed_by("compare 1 --json", capsys)
    printed_by("simulate --vehicle small --seconds 0.3 -o tiny.mcap", capsys)
    assert '"verdict": "' in reply
    assert re.search(r"\d\.\d", reply)
    assert not re.search(r": -?\d+,\d", reply)


def test_steps_on_the_vehicle_use_the_language_of_the_laptop(in_strange_letters):
    from baqueano.robot.setup.install import translated_steps

    with language.use_language("es"):
        text = translated_steps()
    scope: dict = {"__name__": "steps"}
    exec(compile(text, "steps.py", "exec"), scope)
    assert scope["_"]("{user} is in {groups}", user="ana", groups="i2c") == f"ana {strange('is in')} i2c"


def test_import_warnings_are_stored_as_data_in_english(in_lab, capsys):
    printed_by("runs import w.toml log.csv -o imported.mcap", capsys)
    run = read_run("imported.mcap")
    warnings = [event for event in run.events if event.source == "import" and event.level == "warning"]
    assert warnings
    for warning in warnings:
        assert warning.diagnostic.figures["cause"].code.startswith("recording.")
        assert warning.text == english_text(warning.diagnostic)
        with language.use_language("es"):
            assert warning.sentence != warning.text


def test_files_of_a_new_project_have_spanish_comments(in_lab, capsys):
    printed_by("new proyecto", capsys)
    texts = {path.name: path.read_text(encoding="utf-8") for path in Path("proyecto").iterdir()}
    assert "Ejecute las celdas" in texts["first_evening.ipynb"]
    assert re.findall(r'names=\[\\"(\w+)', texts["first_evening.ipynb"]) == ["controlador", "estimador"]
    for name in ("my_estimator.py", "my_guide.py", "my_controller.py"):
        assert "Funciona sin cambios." in texts[name]
        assert "Devuelve " in texts[name]
        assert not re.search(r"\b(Return|the|a guess)\b", texts[name])
        compile(texts[name], name, "exec")


def test_one_placeholder_has_one_name_in_all_helps():
    """FOLDER beside CARPETA in one help looks like two different things."""
    language.choose_language("es")
    commands = [translate_command(command) for _, command in helps()]
    metavars = [p.make_metavar(click.Context(command)) for command in commands for p in command.params]
    words = {word for metavar in metavars for word in re.findall(r"[A-Z]{3,}", metavar)}
    assert {"ARCHIVO", "CARPETA", "CLAVE", "CORRIDA", "CORRIDAS", "MAPA", "NOMBRE", "RUTA"} <= words
    assert words.isdisjoint(set(language.PLACEHOLDERS) - {"FACTOR"})


def test_a_file_and_a_folder_have_one_placeholder_each_in_english_helps():
    commands = [translate_command(command) for _, command in helps()]
    words = {p.make_metavar(click.Context(command)) for command in commands for p in command.params}
    assert {"FILE", "FOLDER"} <= words
    assert words.isdisjoint({"PATH", "DIRECTORY"})
