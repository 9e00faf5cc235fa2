"""Describe a block for the page: its text, its parameters, the time of a step, and the blocks that could replace it.

A class of the user is found in its source text, without executing it. It is executed only after a person has selected
it, from the folder of the vehicle file or the folder where the page was started. A browser cannot send source text.
"""

import ast
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from baqueano.block_checks.source_text import is_in_package, source_text
from baqueano.blocks import BLOCK_TARGETS, kinds, resolve
from baqueano.contracts.values import JsonObject, Tree
from baqueano.errors import FileError, UsageError
from baqueano.parameter import all_parameters

if TYPE_CHECKING:
    from baqueano.vehicle_file.file import VehicleFile

INPUT_ROLES = {
    ("tick",): "estimator", ("estimate",): "guide", ("reference", "estimate"): "controller",
    ("command", "tick", "estimate"): "supervisor",
}  # fmt: skip
LOOP_ROLES = ("estimator", "guide", "controller", "supervisor")
SWAPPABLE_ROLES = ("estimator", "guide", "controller")
MAX_TEXT_LETTERS = 60_000  # maximum number of characters of a file that are shown
FILES, LARGEST = 50, 200_000  # maximum number of files of the user's folder, and of bytes of each
CALLS, ROUNDS = 50, 5  # calls in a round, and rounds, to time a step
MAX_SHOWN_NUMBERS = 9  # maximum number of values of an array that are shown


def block_description(request: JsonObject, vehicle_file: "VehicleFile") -> JsonObject:
    """Return what the page shows about the block of a role, or about a block of another `kind` in its place.

    Raise UsageError if the kind is not in the list of the role.
    """
    role, kind = request["room"], request["kind"]
    file_kind = _file_kind(role, vehicle_file)
    alternatives = available_kinds(role, vehicle_file) if role in SWAPPABLE_ROLES else []
    if kind and kind not in alternatives and kind != file_kind:
        raise UsageError.of("web.no-kind", role=role, value=repr(kind), valid=alternatives)
    block = make_block(role, kind or file_kind, vehicle_file)
    cls = type(block)
    return {
        "room": role, "kind": kind or file_kind, "of_file": file_kind, "kinds": alternatives, "name": cls.__name__,
        "ours": is_in_package(cls), "parameters": _parameter_rows(role, block), **_class_text(cls),
        "step_us": step_time_us(role, kind or file_kind, vehicle_file) if role in LOOP_ROLES else None,
        "tick_us": 1e6 / vehicle_file.rate_hz,
    }  # fmt: skip


def check_block(request: JsonObject, vehicle_file: "VehicleFile") -> JsonObject:
    """Return the findings of `blocks check` about the block of a role, or about a block of another `kind`."""
    from baqueano.vehicle_file.block_check import check

    # refuses a kind that is not in the list
    block_description(request | {"kind": request["kind"]}, vehicle_file)
    role = request["room"]
    report = check(
        make_block(role, request["kind"] or _file_kind(role, vehicle_file), vehicle_file), vehicle_file, role
    )
    return {"findings": [finding.to_json() for finding in report.findings]}


def available_kinds(role: str, vehicle_file: "VehicleFile") -> list[str]:
    """Return the kinds for a role: the built-in kinds and the classes of the user's folder."""
    return [*kinds(role), *user_block_kinds(role, vehicle_file)]


def user_block_kinds(role: str, vehicle_file: "VehicleFile") -> list[str]:
    """Return "file.py:Class" for each class in the user's folder whose source text shows this role.

    At most FILES files are read. Symbolic links and files over LARGEST bytes are ignored.
    """
    kinds = []
    for path in sorted(Path(vehicle_file.folder or ".").glob("*.py"))[:FILES]:
        if path.is_symlink() or path.stat().st_size > LARGEST:
            continue
        try:
            tree = ast.parse(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, SyntaxError):
            continue
        classes = [class_ for class_ in tree.body if isinstance(class_, ast.ClassDef)]
        kinds += [f"{path.name}:{class_.name}" for class_ in classes if _class_role(class_) == role]
    return kinds


def _class_role(cls: ast.ClassDef) -> str:
    """Return the role of a class, from the inputs of its `step` or its base class; "" if neither shows a role."""
    steps = [
        function for function in cls.body if isinstance(function, ast.FunctionDef) and function.name == "step"
    ]
    if steps:
        return INPUT_ROLES.get(tuple(a.arg.lstrip("_") for a in steps[0].args.args[2:]), "")
    bases = {getattr(base, "attr", getattr(base, "id", "")) for base in cls.bases}
    role_by_base = {
        target.partition(":")[2]: role for role in LOOP_ROLES for target in BLOCK_TARGETS[role].values()
    }
    return next((role for name, role in role_by_base.items() if name in bases), "")


def make_block(role: str, kind: str, vehicle_file: "VehicleFile") -> Tree:
    """Return the block of this kind for a role, built with the values of the vehicle file."""
    from baqueano.guides.shapes import circle

    if role == "vehicle":
        return vehicle_file.vehicle
    if role == "sensors":
        return next(iter(vehicle_file.sensors), None)
    own_kind = None if kind == _file_kind(role, vehicle_file) else kind
    if own_kind is not None:  # selected in a browser; the file's block needs the user's permission
        resolve(role, own_kind, vehicle_file.folder)
    if role == "guide":
        return vehicle_file.guide(circle(1.0, 0.25), own_kind)
    return getattr(vehicle_file, role)(own_kind)


def _file_kind(role: str, vehicle_file: "VehicleFile") -> str:
    from baqueano.vehicle_file.build import DEFAULT_KINDS

    table = vehicle_file.data.get({"vehicle": "model"}.get(role, role), {})
    return str(table.get("kind", DEFAULT_KINDS.get(role, "")) if isinstance(table, dict) else "")


def step_time_us(role: str, kind: str, vehicle_file: "VehicleFile") -> float | None:
    """Return the time [µs] of one step of this block, compiled as in a drive and measured on this machine.

    Return None if a block of the loop raises an error, or if its execution is not permitted.
    """
    from baqueano import loop
    from baqueano.drive.session import compile_blocks, example_tick
    from baqueano.loop import Blocks

    try:
        blocks_by_role = {
            part: make_block(part, kind if part == role else _file_kind(part, vehicle_file), vehicle_file)
            for part in LOOP_ROLES
        }
    except FileError:
        return None
    tick = example_tick(vehicle_file)
    quick_blocks, _ = compile_blocks(Blocks(**blocks_by_role), tick, "auto")
    states = loop.init(quick_blocks)
    try:
        _, estimate = quick_blocks.estimator.step(states.estimator, tick)
        _, reference = quick_blocks.guide.step(states.guide, estimate)
        _, command = quick_blocks.controller.step(states.controller, reference, estimate)
    except Exception:  # an error in a user's block, which `blocks check` reports
        return None
    inputs = {"estimator": (tick,), "guide": (estimate,), "controller": (reference, estimate),
              "supervisor": (command, tick, estimate)}[role]  # fmt: skip
    step, state = getattr(quick_blocks, role).step, getattr(states, role)
    rounds = []
    for _ in range(ROUNDS):
        start_s = time.perf_counter()
        for _ in range(CALLS):
            step(state, *inputs)
        rounds.append(time.perf_counter() - start_s)
    return 1e6 * min(rounds) / CALLS


def _class_text(cls: type) -> JsonObject:
    """Return file name, source text (at most MAX_TEXT_LETTERS characters) and line number, from 0, of a class."""
    text = source_text(cls)
    module = cls.__module__.removeprefix("baqueano.").replace(".", "/")
    return {"file": f"{module}.py" if is_in_package(cls) else f"{cls.__name__}", "text": text[:MAX_TEXT_LETTERS],
            "line": _class_line(text, cls.__name__)}  # fmt: skip


def _class_line(text: str, name: str) -> int:
    """Return the line number, from 0 on, at which the class begins; 0 if it is not found."""
    return next((k for k, line in enumerate(text.splitlines()) if line.startswith(f"class {name}")), 0)


def _parameter_rows(role: str, block: object) -> list[JsonObject]:
    rows = []
    for path, entry in all_parameters(block, role):
        value: Tree = block
        for name in path.split(".")[1:]:
            value = getattr(value, name)
        array = np.asarray(value, dtype=float) if value is not None else np.zeros(0)
        numbers = array.ravel().tolist() if array.size <= MAX_SHOWN_NUMBERS else None
        rows.append({
            "name": path.partition(".")[2], "unit": "" if entry.unit == "1" else entry.unit, "meaning": entry.meaning,
            "value": numbers, "shape": " × ".join(map(str, array.shape)),
        })  # fmt: skip
    return rows
