"""Find the block of a `kind` in the vehicle file: a short name of the package, or your own "file.py:Class".

Code that a vehicle file or a run names is executed if it is in the same folder, or if the user named it. Code from
elsewhere is executed only if the user allows this, because the code runs with all rights of the user. A role is a
category of blocks, such as "sensor". block_checks checks the contract of each role, for the author of a block.
"""

import importlib
import importlib.util
import inspect
import os
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType

from baqueano.block_checks.source import place as place_of
from baqueano.contracts.blocks import STEP_INPUTS
from baqueano.contracts.time_limit import HANG_S, PREPARE_S, within
from baqueano.diagnostics import Diagnostic, nearest, note
from baqueano.errors import (
    USER_MODULE_PREFIX,
    FileError,
    UsageError,
    error_text,
    is_interruption,
    user_code_place,
)

__all__ = ["kinds", "resolve"]

PROGRAM = "__main__"  # Python's name of the module of a notebook or a script
BLOCK_TARGETS: dict[str, dict[str, str]] = {
    "vehicle": {
        "planar": "baqueano.vehicles:Planar",
        "kinematic": "baqueano.vehicles:Kinematic",
        "car": "baqueano.vehicles:Car",
    },
    "sensor": {
        "imu": "baqueano.sensors:Imu",
        "wheels": "baqueano.sensors:Wheels",
        "odometer": "baqueano.sensors:Odometer",
        "pose": "baqueano.sensors:Pose",
        "mark": "baqueano.sensors:Mark",
        "tags": "baqueano.sensors:Tags",
        "beacon": "baqueano.sensors:Beacon",
        "rangefinder": "baqueano.sensors:Rangefinder",
        "compass": "baqueano.sensors:Compass",
        "encoders": "baqueano.sensors:Encoders",
    },
    "estimator": {
        "ekf": "baqueano.estimators:Ekf",
        "augmented_ekf": "baqueano.estimators:AugmentedEkf",
        "complementary": "baqueano.estimators:Complementary",
        "dead_reckoning": "baqueano.estimators:DeadReckoning",
        "unscented": "baqueano.estimators:Unscented",
    },
    "guide": {
        "repeat": "baqueano.guides:Repeat",
        "repeat_by_progress": "baqueano.guides:RepeatByProgress",
        "sinuous_circle": "baqueano.guides:SinuousCircle",
    },
    "controller": {
        "pd": "baqueano.controllers:Pd",
        "pd_feedforward": "baqueano.controllers:PdFeedforward",
        "kanayama": "baqueano.controllers:Kanayama",
        "lqr": "baqueano.controllers:Lqr",
        "mpc": "baqueano.controllers:Mpc",
        "pure_pursuit": "baqueano.controllers:PurePursuit",
        "stanley": "baqueano.controllers:Stanley",
    },
    "supervisor": {"supervisor": "baqueano.supervisor:Supervisor"},
}

LOOP_ROLES = tuple(STEP_INPUTS)  # the roles of the blocks in a drive
WORKING_FILE = "vehicle.toml"  # vehicle file of the project in the working directory
_trusted_files: set[Path] = set()  # files of blocks that the user named or allowed in this process
ALLOW = "BAQUEANO_ALLOW_BLOCKS"  # set to 1 if the user allows code that files of other people name
_modules: dict[tuple[str, str], ModuleType] = {}  # modules of the user's files, by path and content


def kinds(role: str) -> tuple[str, ...]:
    """Return the short names of the package's blocks for a role.

    Parameters
    ----------
    role : str
        "vehicle", "sensor", "estimator", "guide", "controller" or "supervisor".

    Returns
    -------
    tuple of str
        The possible values of `kind` in a vehicle file.

    Raises
    ------
    UsageError
        For another role.

    Examples
    --------
    >>> kinds("guide")
    ('repeat', 'repeat_by_progress', 'sinuous_circle')
    """
    if role not in BLOCK_TARGETS:
        raise UsageError.of("block.role-unknown", value=role, suggestion=nearest(role, BLOCK_TARGETS))
    return tuple(BLOCK_TARGETS[role])


def resolve(role: str, kind: str, folder: Path | str | None = None) -> type:
    """Return the class of a `kind` that the user names.

    Parameters
    ----------
    role : str
        "vehicle", "sensor", "estimator", "guide", "controller" or "supervisor".
    kind : str
        Short name of a block of the package, "file.py:Class", or "__main__:Class" for a class of a notebook cell.
    folder : path, optional
        Folder to search first for a relative file; the working directory is searched second.

    Returns
    -------
    type
        The class.

    Raises
    ------
    FileError
        If the file or the class does not exist; the message contains the nearest names.

    Examples
    --------
    >>> resolve("controller", "pd").__name__
    'Pd'
    """
    names = kinds(role)
    if kind in names:
        return _target_class(BLOCK_TARGETS[role][kind])
    file_name, colon, name = kind.rpartition(":")
    if file_name == PROGRAM:
        return _module_class(sys.modules[PROGRAM], PROGRAM, name)
    if colon and file_name.endswith(".py"):
        path = _find(file_name, folder)
        return _module_class(_module(path), path.name, name)
    if kind.endswith(".py") and _find_file(kind, folder) is not None:
        raise FileError.of("block.without-class", value=kind, classes=describe_classes(kind, folder))
    if colon and _find_file(f"{file_name}.py", folder) is not None:
        names = (f"{file_name}.py:{name}", *names)
    figures = {"role": role, "value": kind, "suggestion": nearest(kind, names)}
    for other_role in (other for other in BLOCK_TARGETS if kind in kinds(other)):
        raise FileError.of("block.in-other-role", actual_role=other_role, **figures)
    raise FileError.of("block.unknown", **figures)


def _target_class(target: str) -> type:
    module, name = target.split(":")
    return getattr(importlib.import_module(module), name)


@contextmanager
def permit_blocks(allow: bool = True) -> Iterator[None]:
    """Permit, within the context, blocks that vehicle files and runs of other people name, if `allow` is true.

    Processes that are started within the context permit them too: the workers of a page and its simulated vehicle.
    """
    previous_permission = os.environ.get(ALLOW)
    if allow:
        os.environ[ALLOW] = "1"
    try:
        yield
    finally:
        if allow and previous_permission is None:
            del os.environ[ALLOW]
        elif allow:
            os.environ[ALLOW] = str(previous_permission)


def resolve_named(role: str, kind: str, folder: Path | str | None = None) -> type:
    """Return the class of a `kind` that a vehicle file in `folder` names; if `folder` is None, a run names it.

    Raise FileError for code outside `folder` that the user neither named nor allowed. Code in the working directory is
    allowed if `folder` is also in that directory. A run with a path outside the working directory always raises
    FileError.
    """
    file_name = kind if kind.endswith(".py") else kind.rpartition(":")[0]
    path = _find_file(file_name, folder) if file_name.endswith(".py") else None
    if path is None:
        is_outside = folder is None and file_name.endswith(".py") and _is_outside_folder(Path(file_name))
        if is_outside:
            raise FileError.of("block.in-run-elsewhere", kind=kind)
        return resolve(role, kind, folder)
    working_folder = Path.cwd().resolve()
    if folder is None:
        if _is_outside_folder(Path(file_name)) or not path.is_relative_to(working_folder):
            raise FileError.of("block.in-run-elsewhere", kind=kind)
        is_allowed, code = _is_in_working_file(kind), "block.in-run"
    else:
        file_folder = Path(folder).resolve()
        is_allowed = path.is_relative_to(file_folder) or (
            file_folder.is_relative_to(working_folder) and path.is_relative_to(working_folder)
        )
        code = "block.outside-folder"
    if not (is_allowed or path in _trusted_files or os.environ.get(ALLOW) == "1"):
        raise FileError.of(code, kind=kind, path=path)
    return resolve(role, kind, folder)


def _is_outside_folder(file: Path) -> bool:
    return file.expanduser().is_absolute() or file.is_absolute() or ".." in file.parts


def _is_in_working_file(kind: str) -> bool:
    """Return True if the vehicle file in the working directory also names this block."""
    try:
        tables = list(tomllib.loads(Path(WORKING_FILE).read_text(encoding="utf-8")).values())
    except (OSError, ValueError, RecursionError):
        return False
    tables += [inner for table in tables if isinstance(table, dict) for inner in table.values()]
    return any(isinstance(table, dict) and table.get("kind") == kind for table in tables)


def infer_role(block_class: type) -> str:
    """Return the role of a class of the user, from the arguments of its `step`. Raise FileError if none matches."""
    step = getattr(block_class, "step", None)

    def figures() -> dict[str, str]:  # only of an error: a place is searched in the source for 5 ms
        return {"place": place_of(block_class), "block": block_class.__name__}

    if not callable(step):
        raise FileError.of("block.no-step", **figures())
    for method, role in (("advance", "vehicle"), ("h", "sensor")):
        if hasattr(block_class, method):
            return role
    names = [name.lstrip("_") for name in inspect.signature(step).parameters]
    if names[:1] in (["state"], ["belief"]) and tuple(names[1:]) in STEP_INPUTS.values():
        raise FileError.of("block.step-without-self", names=", ".join(names), **figures())
    for role, inputs in STEP_INPUTS.items():
        if tuple(names[2:]) == inputs:
            return role
    raise FileError.of("block.no-role", names=names[2:], **figures())


def check_role(role: str, block: object) -> None:
    """Raise UsageError if a class or block of the user does not fit `role`.
    It does not fit without `init` or `step`, or if its `step` has the arguments of another role of the loop.
    """
    block_class = block if isinstance(block, type) else type(block)
    missing_methods = [name for name in ("init", "step") if not callable(getattr(block_class, name, None))]
    if len(missing_methods) == 1:
        raise UsageError.of(
            "block.lacks-method", role=role, block=block_class.__name__, method=missing_methods[0]
        )
    if missing_methods:
        raise UsageError.of("block.not-a-block", role=role, value=block_class.__name__)
    check_step(role, block_class, lambda fitting_role: f"{fitting_role}={block_class.__name__}")


def check_step(role: str, block_class: type, remedy: Callable[[str], str]) -> None:
    """Raise UsageError if `step` of a class does not accept the inputs of `role`, or has the inputs of another role.
    `remedy` gives the fix for that role."""
    step, inputs = getattr(block_class, "step", None), STEP_INPUTS.get(role, ())
    if not inputs or step is None:
        return
    try:
        fitting_role = infer_role(block_class)
    except FileError:  # its inputs have other names
        fitting_role = role
    signature = inspect.signature(step)
    is_of_other_role = fitting_role != role and fitting_role in LOOP_ROLES
    with suppress(TypeError):
        signature.bind(block_class, role, *inputs)
        if not is_of_other_role:
            return
    figures = {  # the place needs the file of the class
        "place": place_of(step), "block": block_class.__name__, "names": ", ".join(list(signature.parameters)[1:]),
        "role": role, "expected": ", ".join(("state", *inputs)),
    }  # fmt: skip
    if is_of_other_role:
        fix = remedy(fitting_role)
        raise UsageError.of("block.of-other-role", fix, actual_role=fitting_role, **figures)
    raise UsageError.of("block.step-arguments", **figures)


def _find(file: str, folder: Path | str | None) -> Path:
    path, user_path = Path(file).expanduser(), _find_file(file, folder)
    if user_path is not None:
        return user_path
    candidates = _candidate_paths(path, folder)
    suggestion = nearest(path.name, sorted(p.name for p in candidates[0].parent.glob("*.py")))
    raise FileError.of("block.file-absent", absent_path=candidates[0], value=path.name, suggestion=suggestion)


def _find_file(file: str, folder: Path | str | None) -> Path | None:
    """Return the path of the file in the first searched folder that contains it; None if no folder contains it."""
    candidates = _candidate_paths(Path(file).expanduser(), folder)
    return next((candidate.resolve() for candidate in candidates if candidate.is_file()), None)


def _candidate_paths(path: Path, folder: Path | str | None) -> list[Path]:
    return [path] if path.is_absolute() or folder is None else [Path(folder) / path, path]


def _block_names(module: ModuleType) -> list[str]:
    """Return the names of the blocks that a module defines: its classes with `step`, or all if none has this method."""
    classes = {
        n: x for n, x in vars(module).items() if inspect.isclass(x) and x.__module__ == module.__name__
    }
    return [name for name, x in classes.items() if callable(getattr(x, "step", None))] or list(classes)


def read_module(file: str, folder: Path | str | None = None) -> ModuleType:
    """Return a user's file as a module, which runs once for each content. Raise FileError with the line if it fails."""
    return _module(_find(file, folder))


def describe_classes(file: str, folder: Path | str | None = None) -> Diagnostic:
    """Return a message with the blocks "file.py:Class" of a file. Raise FileError if the file cannot be read."""
    class_names = [f"{file}:{name}" for name in _block_names(read_module(file, folder))]
    if class_names:
        return note("block.classes", file=file, classes=class_names)
    return note("block.no-classes", file=file)


def block_kind(block_class: type) -> str:
    """Return the `kind` of a class, for a vehicle file: the inverse of `resolve`.

    >>> from baqueano.vehicles import Planar
    >>> block_kind(Planar)
    'planar'
    """
    targets = {target: kind for role in BLOCK_TARGETS.values() for kind, target in role.items()}
    if block_class.__module__.startswith("baqueano."):
        return next(kind for target, kind in targets.items() if target.endswith(f":{block_class.__name__}"))
    if block_class.__module__ == PROGRAM:
        return f"{PROGRAM}:{block_class.__name__}"
    return f"{inspect.getfile(block_class)}:{block_class.__name__}"


def _module_class(module: ModuleType, file: str, name: str) -> type:
    member = getattr(module, name, None)
    if member is None and file == PROGRAM:
        raise FileError.of("block.cell-class-unknown", value=name)
    if member is None:
        suggestion = nearest(name, _block_names(module))
        raise FileError.of("block.class-unknown", file=file, value=name, suggestion=suggestion)
    if not inspect.isclass(member):
        raise FileError.of("block.not-class", file=file, value=name, kind=type(member).__name__)
    return member


def _check_encoding(name: str, content: bytes) -> None:
    """Raise FileError for a file with letters that are not UTF-8, unless it names their encoding in its first lines.
    Python accepts such letters in a comment, but the text of a block is stored with each run."""
    with suppress(SyntaxError, UnicodeDecodeError):
        importlib.util.decode_source(content)
        return
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise FileError.of("toml.not-utf-8", file=name, line=line, byte=content[error.start]) from None


def _module(path: Path) -> ModuleType:
    import hashlib  # imported here because it loads OpenSSL, which only blocks of the user need

    content = path.read_bytes()
    key = (str(path), hashlib.sha256(content).hexdigest())
    if key in _modules:
        return _modules[key]
    _check_encoding(path.name, content)
    name = f"{USER_MODULE_PREFIX}{path.stem}_{hashlib.sha256(repr(key).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise FileError.of("block.not-module", path=path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.append(str(path.parent))  # so that the file can import the modules beside it
    try:
        within(HANG_S, exec, compile(content, path, "exec"), module.__dict__, import_s=PREPARE_S)
    except SyntaxError as error:
        del sys.modules[name]
        where = {"file": path.name, "line": error.lineno or 1, "text": (error.text or "").strip()}
        raise FileError.of("block.not-python", **where, error=error.msg) from error
    except BaseException as error:
        del sys.modules[name]
        if is_interruption(error):
            raise
        is_late = isinstance(error, TimeoutError)
        suffix = "-too-long" if is_late else "" if isinstance(error, Exception) else "-and-ends"
        where = {"place": user_code_place(error) or path.name, "error": error_text(error)}
        raise FileError.of(f"block.raised-while-read{suffix}", **where) from error
    finally:
        sys.path.remove(str(path.parent))
    _modules[key] = module
    _trusted_files.add(path)
    return module
