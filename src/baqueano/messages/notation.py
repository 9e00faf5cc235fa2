"""Write arguments and commands in the notation of the reader: calls in Python, lines on the command line.

An argument:  {arg[use]:gps}             →  use = "gps"                    or  --use gps
A command:    baqueano replay 'my run'   →  run = bq.replay(run)           or  unchanged
Options:      --cost innovations         →  bq.FitOptions(cost="innovations")
A command without a function in Python, such as `baqueano robot flash`, is unchanged.
"""

import os
import re
import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

PLACEHOLDER = "…"  # in the place of a value that the user chooses
OPTIONS = {  # argument of `identify` → option, and the name of its value
    "free": ("--free", "KEY"),
    "fixed": ("--fix", "KEY"),
    "bounds": ("--bound", "KEY=LOW,HIGH"),
    "use": ("--use", "SENSOR"),
    "per_run": ("--per-run", "KEY"),
    "clocks": ("--clock", "SENSOR"),
    "segment_s": ("--segment", "SECONDS"),
    "cost": ("--cost", "simulation"),
    "speed_noise": ("--speed-noise", ""),
    "measured": ("--measured", '"TIME: LENGTH, ANGLE"'),
    "tolerance": ("--tolerance", "KEY=FRACTION"),
    "start": ("--set", "KEY=VALUE"),
}
EXPERIMENT = (
    'run = bq.experiment(robot, bq.excitation("random_steps", robot.command.limit, 60.0, robot.rate_hz))'
)
CALLS = {  # words of a line → call; {0} is the first argument, and {name} the value of --name
    "new": "bq.new({0})",
    "experiment": EXPERIMENT,
    "identify": "fit = bq.identify(run, robot)",
    "identify --update": "fit = bq.identify(run, robot); robot = fit.vehicle_file",
    "tune": "robot = bq.tune(robot, route).updated_file()",
    "tune --controller": "robot = bq.tune(robot, route, controller={controller}).updated_file()",
    "tune --controller --out": "bq.tune(robot, route, controller={controller}).updated_file().save({out})",
    "teach": "route = bq.teach(robot, path, closed=True).route",
    "repeat": "run = bq.repeat(robot, route)",
    "replay": "run = bq.replay(run)",
    "replay --estimator": "run = bq.replay(run, estimator={estimator})",
    "compare": "bq.compare(run)",
    "forecast": "bq.forecast(robot, route)",
    "blocks check": "bq.check({0})",
    "runs ls": "from pathlib import Path; sorted(Path({runs}).glob('*.mcap'))",
    "runs cut --from --to": "run = run.cut({from}, {to})",
    "runs cut --from": "run = run.cut({from})",
    "runs cut --to": "run = run.cut(0.0, {to})",
    "runs recover": "from baqueano.runs import recover; recover({0})",
    "runs import --draft": "from baqueano.runs import draft_map; print(draft_map({0}, path={draft}))",
    "runs import": "run = bq.import_run({0}, {1}).run",
    "route draw": "from baqueano.guides.shapes import shape; route = shape({1}, 1.0, 0.25)",
    "route smooth --rms": "route = bq.routes.smooth(route, {rms})",
    "route smooth --max": 'route = bq.routes.smooth(route, {max}, "max")',
    "route faster --speed": "route = bq.routes.at_speed(route, {speed})",
    "route faster --command-share": "route = bq.routes.fastest(route, robot, command_share={command-share})",
    "route faster": "route = bq.routes.fastest(route, robot)",
    "route reverse --backing": "route = bq.routes.reverse(route, backing=True)",
    "route scale": "route = bq.routes.scale(route, {1})",
    "route cut --to": "route = bq.routes.cut(route, to_m={to})",
    "route cut --from": "route = bq.routes.cut(route, {from})",
    "--free": "free=[{free}]",
    "--use": "use=[{use}]",
    "--fix": "options=bq.FitOptions(fixed=[{fix}])",
    "--bound": "options=bq.FitOptions(bounds={{{bound}}})",
    "--per-run": "options=bq.FitOptions(per_run=[{per-run}])",
    "--clock": "options=bq.FitOptions(clocks=[{clock}])",
    "--cost": "options=bq.FitOptions(cost={cost})",
    "--set": "robot = robot.with_values({{{set}}})",
    "--vehicle": 'robot = bq.load("vehicle.toml")',
    "--align": "alignment={align}",
    "--jerk": "jerk_m2={jerk}",
    "--choose": "from baqueano.selection.choose import choose; choose(runs, robot)",
    "--held-out": "from baqueano.validation import validate; validate(fit, other_run)",
    "--draft": "path={draft}",
    "--json": "from baqueano.runs import show; show(run).events()",
    "--report": "bq.report(fit, {report})",
    "--room": "room={room}",
    "--animation": "animation={animation}",
    "--table": "table={table}",
}
FLAGS = ("--json", "--update", "--closed", "--backing", "--choose")


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a function in Python's notation: `use`, or with a value `use = "gps"`."""

    name: str

    def __format__(self, value: str) -> str:
        return f'{self.name} = "{value}"' if value else self.name


@dataclass(frozen=True, slots=True)
class Option:
    """An argument in the form in which a user types it; an argument that is not in OPTIONS keeps its name."""

    name: str

    def __format__(self, value: str) -> str:
        option, value_name = OPTIONS.get(self.name, (f"--{self.name.replace('_', '-')}", "VALUE"))
        value_text = value_name if value == PLACEHOLDER else shlex.quote(value) if value else ""
        return f"{option} {value_text}".rstrip()


def python_call(line: str) -> str:
    """Return the call in Python for a line of the command line. A line without such a call is returned unchanged.

    >>> python_call("baqueano runs cut 3 --to 12.5"), python_call("--free +model.mass_kg")
    ('run = run.cut(0.0, 12.5)', 'free=["+model.mass_kg"]')
    """
    try:
        words = shlex.split(line) if os.name != "nt" else re.findall(r'"[^"]*"|\'[^\']*\'|\S+', line)
    except ValueError:  # a quote without its end
        return line
    words = [word.strip("\"'") for word in words]
    is_command = words[:1] == ["baqueano"]
    arguments, options = _split(words[is_command:])
    if not is_command and (arguments or not options):
        return line
    if len(options) > 1 and not is_command and {*options} <= {*CALLS}:
        calls = [
            python_call(" ".join(f"{name} {shlex.quote(value)}" for value in values))
            for name, values in sorted(options.items(), key=lambda option: option[0] != "--set")
        ]
        return ("; " if "--set" in options else ", ").join([calls[0], ", ".join(calls[1:])])
    keys = [key for key in CALLS if _matches_call(key.split(), arguments, options)]
    if not keys:
        return line
    key = max(keys, key=lambda key: len(key.split()))
    word_count = sum(not word.startswith("--") for word in key.split())
    values = {name.removeprefix("--"): ", ".join(map(_literal, words)) for name, words in options.items()}
    for word in options.get("--bound", []):
        path, _, limits = word.partition("=")
        values["bound"] = f'"{path}": ({limits.replace(",", ", ")})'
    if "--set" in options:
        pairs = [word.partition("=") for word in options["--set"]]
        values["set"] = ", ".join(f'"{path}": {_literal(value)}' for path, _, value in pairs)
    return CALLS[key].format(
        *map(_literal, [*arguments[word_count:], "FILE", "FILE"]), **({"runs": '"runs"'} | values)
    )


def _split(words: list[str]) -> tuple[list[str], dict[str, list[str]]]:
    """Return the arguments of a line, and the values of each option, which can be repeated."""
    arguments: list[str] = []
    options: dict[str, list[str]] = {}
    rest_words = iter(words)
    for word in rest_words:
        if word.startswith("--"):
            options.setdefault(word, []).append("" if word in FLAGS else next(rest_words, ""))
        else:
            arguments.append(word)
    return arguments, options


def _matches_call(key: list[str], arguments: list[str], options: dict[str, list[str]]) -> bool:
    """Return True if a key of CALLS begins as these arguments do, and all its options were given."""
    word_count = [word for word in key if not word.startswith("--")]
    has_verbs = arguments[: len(word_count)] == word_count and bool(word_count) == bool(arguments)
    return has_verbs and {*key} - {*word_count} <= {*options}


def _literal(word: str) -> str:
    """Return a word as Python writes it: a number, or a text."""
    return word if re.fullmatch(r"-?\d+(\.\d+)?(e-?\d+)?", word) else '"{}"'.format(word.replace("\\", "/"))


class Notation(NamedTuple):
    """The notation of a reader, for the name of an argument and for a line of the command line."""

    argument: Callable[[str], object]
    command: Callable[[str], str]


PYTHON = Notation(Argument, python_call)
COMMAND_LINE = Notation(Option, str)
_notation = PYTHON


@contextmanager
def use_notation(notation: Notation) -> Iterator[None]:
    """Use this notation for all messages of this process within the context: `main` of a program uses COMMAND_LINE."""
    global _notation
    former_notation, _notation = _notation, notation
    try:
        yield
    finally:
        _notation = former_notation


def current_notation() -> Notation:
    """Return the notation of this process, by default PYTHON."""
    return _notation
