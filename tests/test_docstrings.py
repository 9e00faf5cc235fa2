"""A public name has a docstring that numpydoc can read: parameters, results, errors, source, and an example.

A name is public if `__all__` of a package below contains it. Other packages are private: they do not have `__all__`.
"""

import ast
import dataclasses
import enum
import importlib
import inspect
import re
import textwrap
from types import ModuleType

import pytest
from numpydoc.docscrape import NumpyDocString

from docs.site import reference
from tests.syntax import SOURCE, nodes_of, python_files

ROOMS = [
    "baqueano",
    "block_checks",
    "blocks",
    "compare",
    "contracts",
    "controllers",
    "drive",
    "estimators",
    "geometry",
    "guides",
    "guides.shapes",
    "identify",
    "monitor",
    "parameter",
    "report",
    "routes",
    "routes",
    "runs",
    "sensors",
    "signals",
    "simulate",
    "sweep",
    "symbolic",
    "tune",
    "validation",
    "vehicle_file",
    "vehicles",
    "worlds",
    "worlds.faults",
]
MOST_NAMES = 190  # of all rooms together
MODULE_LINES = 15  # of the docstring of a module: equations and source
# of a parameter, as in mass_kg
UNIT_IN_NAME = re.compile(r"_(?:(?:k?m|m?s|ns|rad|hz|deg|kg|v|std)2?|dps|per_m)$")
VECTOR = re.compile(r"\b(poses?|velocity|velocities)\b", re.I)  # quantities that have components in a frame
SHAPE = re.compile(r"\([^)]*\b[236],?\)")  # of 2, 3 or 6 components
FRAME = re.compile(r"\b(map|body|sensor frame|relative to)\b", re.I)
# a base class and `__getattr__` give no advice to a user
BARE_RAISE = {"NotImplementedError", "AttributeError"}


def module_of(room: str) -> ModuleType:
    return importlib.import_module("baqueano" if room == "baqueano" else f"baqueano.{room}")


def public() -> dict[str, object]:
    """Return the public names and their objects, each once, under the first package that offers it."""
    objects, once = {}, set()
    for room in ROOMS:
        module = module_of(room)
        for name in module.__all__:
            value = getattr(module, name)
            if not isinstance(value, ModuleType) and id(value) not in once:
                once.add(id(value))
                objects[f"{room}.{name}"] = value
    return objects


PUBLIC = public()


def documented_here(value: object) -> bool:
    """Return True if the object is a class or a function of baqueano."""
    return callable(value) and (getattr(value, "__module__", "") or "").startswith("baqueano")


OBJECTS = {name: value for name, value in PUBLIC.items() if documented_here(value)}


@pytest.mark.parametrize("name", OBJECTS)
def test_a_public_name_is_documented(name):
    value = OBJECTS[name]
    doc = NumpyDocString(inspect.getdoc(value) or "")
    lacks = in_a_class(value, doc) if isinstance(value, type) else in_a_function(value, doc)
    lacks += [] if "".join(doc["Summary"]).strip() else ["a summary"]
    lacks += [] if ">>> " in "\n".join(doc["Examples"]) else ["Examples"]
    assert not lacks, f"{name} lacks {', '.join(lacks)}"


FIELDS = ("Parameters", "Attributes", "Other Parameters")


def entries_of(*sections):
    """Yield the public name, the section and the entry of each documented value."""
    for name, value in OBJECTS.items():
        doc = NumpyDocString(inspect.getdoc(value) or "")
        yield from ((name, section, entry) for section in sections for entry in doc[section])


def described(entry):
    return " ".join([entry.type, *entry.desc])


def is_number(entry):
    return bool(re.search(r"\b(float|ndarray)\b", entry.type)) and "bool" not in entry.type


def test_a_pose_or_velocity_of_a_public_name_states_its_frame():
    lacks = [
        f"{name}: {entry.name or section}: {described(entry)}"
        for name, section, entry in entries_of(*FIELDS, "Returns", "Yields")
        if VECTOR.search(described(entry)) and SHAPE.search(described(entry))
        if not FRAME.search(described(entry))
    ]
    assert not lacks, "name the frame (map, body, sensor frame, relative to): " + "; ".join(lacks)


def test_a_number_of_a_public_name_states_its_unit():
    lacks = [
        f"{name}: {entry.name or section} : {entry.type}"
        for name, section, entry in entries_of(*FIELDS, "Returns", "Yields")
        if is_number(entry) and "[" not in described(entry)
        if not all(UNIT_IN_NAME.search(part) for part in entry.name.split(", "))
    ]
    assert not lacks, "write its unit, such as [m/s] or [no unit]: " + "; ".join(lacks)


# a name with the same meaning in several places, whose unit depends on the place
OWN_UNITS = {
    **dict.fromkeys(("measurement_noise_cov", "noise_std"), "of the readings of the sensor"),
    **dict.fromkeys(("initial_std", "process_noise_std"), "of the state of the filter or of the vehicle"),
    "cost": "of the objective of the search",
}


def test_a_name_has_one_unit_in_all_places():
    units: dict[str, set[str]] = {}
    for _, _, entry in entries_of(*FIELDS):
        unit = re.search(r"\[([^]]+)]", described(entry))
        if unit and is_number(entry):
            for name in entry.name.split(", "):
                units.setdefault(name, set()).add(unit[1])
    groups = {
        name: of_name
        for name, of_name in units.items()
        if len({unit for unit in of_name if not re.search(r"\bunits?\b(?<!no unit)", unit)}) > 1
    }
    assert groups.keys() == OWN_UNITS.keys(), f"one name for one quantity: {groups}"


SYNONYMS = {  # a name that is not used, and the name of the same idea
    "notices": "notes", "remarks": "notes", "directory": "folder", "frequency_hz": "rate_hz", "covariance": "cov",
    "velocity": "nu", "stddev": "std", "time_s": "t_s", "applied": "applied_commands", "vehicle_toml": "vehicle_file",
}  # fmt: skip


def test_an_idea_has_one_name():
    names = {part.strip(): name for name, _, entry in entries_of(*FIELDS) for part in entry.name.split(",")}
    synonyms = {f"{names[name]}.{name}": word for name, word in SYNONYMS.items() if name in names}
    assert not synonyms, f"one name for one idea: {synonyms}"


def in_a_function(function, doc: NumpyDocString) -> list[str]:
    signature = inspect.signature(function)
    parameters = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
    lacks = entries([(str(p).split(":")[0].split("=")[0].strip(), p.annotation) for p in parameters], doc)
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    gives = str(signature.return_annotation)
    if gives not in ("None", "NoReturn") and not (doc["Returns"] or doc["Yields"]):
        lacks.append("Returns")
    error_names = {entry.type for entry in doc["Raises"]}
    lacks += [f"Raises {error}" for error in sorted(errors_raised(tree) - BARE_RAISE - error_names)]
    return lacks + source(doc)


def in_a_class(cls: type, doc: NumpyDocString) -> list[str]:
    if getattr(cls, "_is_protocol", False) or issubclass(cls, BaseException | enum.Enum):
        return []
    if dataclasses.is_dataclass(cls):
        fields = [(field.name, str(field.type)) for field in dataclasses.fields(cls)]
    elif hasattr(cls, "_fields"):
        fields = [(name, str(cls.__annotations__.get(name, ""))) for name in cls._fields]
    else:
        arguments = inspect.signature(cls).parameters.values()
        fields = [
            (p.name, str(p.annotation)) for p in arguments if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
        ]
    lacks = entries([(name, kind) for name, kind in fields if not name.startswith("_")], doc)
    equations = "(1)" in (inspect.getmodule(cls).__doc__ or "") and hasattr(cls, "step")
    return lacks + (
        ["References or Notes"] if equations and not (doc["References"] or doc["Notes"]) else source(doc)
    )


def entries(expected: list[tuple[str, object]], doc: NumpyDocString) -> list[str]:
    """Return the faults in the entries of these parameters: absent, without type, shape or unit."""
    entries_documented = {
        name.strip(): entry
        for entry in [*doc["Parameters"], *doc["Attributes"], *doc["Other Parameters"]]
        for name in entry.name.split(",")
    }
    lacks = []
    for name, annotation in expected:
        entry = entries_documented.get(name)
        if entry is None:
            lacks.append(f"the parameter {name}")
            continue
        text = " ".join([entry.type, *entry.desc])
        if not entry.type or not "".join(entry.desc).strip():
            lacks.append(f"type and meaning of {name}")
        if "ndarray" in str(annotation) and not re.search(r"\([^)]*,[^)]*\)|\(\)", text):
            lacks.append(f"the shape of {name}")
    return lacks


def errors_raised(function: ast.AST) -> set[str]:
    """Return the names of the errors in the `raise` statements of the function itself."""
    return {
        ast.unparse(node.exc.func).removesuffix(".of").rpartition(".")[2]
        for node in ast.walk(function)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
    }


def source(doc: NumpyDocString) -> list[str]:
    """Return the faults of a docstring that cites an equation by its number."""
    text = " ".join([*doc["Summary"], *doc["Extended Summary"]])
    if re.search(r" \(\d\)", text) and not (doc["Notes"] or doc["References"]):
        return ["References or Notes"]
    return []


def test_each_public_package_has_a_page_in_the_reference():
    pages = {room.removeprefix("baqueano.") for room in reference.ROOMS}
    assert not {*ROOMS} - pages


def test_the_number_of_public_names_is_limited():
    assert len(PUBLIC) <= MOST_NAMES, len(PUBLIC)


def test_a_private_package_has_no_list_of_public_names():
    offering = {
        path.relative_to(SOURCE).as_posix().removesuffix("/__init__.py").removesuffix(".py").replace("/", ".")
        for path in python_files(SOURCE)
        if re.search(r"^__all__ = ", path.read_text(encoding="utf-8"), re.M)
    }
    assert not offering - {*ROOMS, "__init__"}, "write no __all__ there, or name the room in ROOMS"


def test_the_docstring_of_a_module_is_short():
    long = {}
    for path in python_files(SOURCE):
        text = ast.get_docstring(nodes_of(path)[0]) or ""
        if (lines := len(text.splitlines())) > MODULE_LINES:
            long[path.relative_to(SOURCE).as_posix()] = lines
    assert not long, f"derivations stand in docs/derivations/, measured figures in docs/benchmarks.md: {long}"
