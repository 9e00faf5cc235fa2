"""Manage the folder of runs: numbered files, newest last.

`runs/0001-experiment.mcap`, `runs/0002-teach.mcap`, …: each new run has the next number. `reserve_path` reserves it,
even if two programs request a number at the same time.
"""

import os
import re
import unicodedata
from contextlib import suppress
from pathlib import Path
from typing import TypeGuard

from baqueano.errors import FileError, UsageError
from baqueano.messages.printable import baqueano_command

NUMBERED_NAME = re.compile(r"(\d{4,})-.*\.mcap")
RECOVERED_SUFFIX = "-recovered"  # suffix of the name of a run that `runs recover` saved
RUN_NAME = re.compile(r"\w[\w .,+=@()-]*\.mcap")
MAX_NAME_LETTERS = 120  # maximum number of characters of a name
# reserved by Windows
DEVICE_NAME = re.compile(r"(CON|PRN|AUX|NUL|CON(IN|OUT)|(COM|LPT)[0-9¹²³])[ .]", re.IGNORECASE)
GLOB_LETTERS = re.compile(r"[*?]|\[[^]]+\]")
NUMBER_RANGE = re.compile(r"(\d+)-(\d+)(?::(\d+))?")


def new_path(folder: Path | str, label: str) -> Path:
    """Return `folder/NNNN-label.mcap` with the next free number. The number is not reserved; see `reserve_path`.
    Create the folder if it does not exist; raise FileError if that fails.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError.of("runs.folder-not-made", folder=folder, error=error.strerror or error) from error
    number = max((run_number(path) or 0 for path in folder.iterdir()), default=0) + 1
    return folder / f"{number:04d}-{plain_label(label)}.mcap"


def path_of_run(path: Path | str, label: str) -> Path:
    """Return the file of a new run at `path`: a file, or a folder, in which the run receives the next number.
    A name without an ending is a folder. Raise UsageError if the ending is not .mcap.
    """
    path = Path(path)
    if path.is_dir() or not path.suffix:
        return new_path(path, label)
    if path.suffix.lower() != ".mcap":
        raise UsageError.of("runs.ending", path=path, name=path.with_suffix(".mcap").name)
    return path


def plain_label(label: str) -> str:
    """Return a label without the characters that are not allowed in a file name."""
    simple_name = unicodedata.normalize("NFC", label).strip().replace(" ", "-")
    return re.sub(r'[<>:"/\\|?*]', "", "".join(filter(str.isprintable, simple_name))).strip(".")[:60] or "run"


def is_run_name(name: object) -> TypeGuard[str]:
    r"""Return True if a file name from an external source is valid for a run in any folder of any system.

    >>> [is_run_name(name) for name in ("20260314-101500-repeat.mcap", "../x.mcap", "C:x.mcap", "nul.mcap", ".mcap")]
    [True, False, False, False, False]
    """
    if not isinstance(name, str) or len(name) > MAX_NAME_LETTERS or not name.isprintable():
        return False
    return bool(RUN_NAME.fullmatch(name)) and not DEVICE_NAME.match(name) and name[-6] not in ". "


def run_number(path: Path) -> int | None:
    """Return the number in the file name of a run, or None without a number."""
    match = NUMBERED_NAME.fullmatch(path.name.removesuffix(".part"))
    return int(match[1]) if match else None


def number_and_name(path: Path) -> tuple[int, str]:
    """Return the number of a run, or 0, and its file name: the key by which runs are sorted."""
    return run_number(path) or 0, path.name


def find(name: str, folder: Path | str = "runs") -> Path:
    """Return the path of a run, given by path, number (`3`, `0003`) or name; `last` is the run with the highest number.
    An existing path is returned unchecked, and so is a path with a suffix, unless it is the name of a run.
    Raise FileError if no run or several runs match.
    """
    path, folder = Path(name), Path(folder)
    if path.exists():
        return path
    runs = sorted(folder.glob("*.mcap")) if folder.is_dir() else []
    numbered_runs = [run for run in _without_recovered_originals(runs) if run_number(run) is not None]
    if name == "last" and numbered_runs:
        return max(numbered_runs, key=lambda run: run_number(run) or 0)
    matches = [run for run in runs if run.stem == name]
    if path.suffix and not matches:
        return path
    matches = matches or [run for run in numbered_runs if name.isdecimal() and run_number(run) == int(name)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        stems = [run.stem for run in matches]
        raise FileError.of("runs.ambiguous", value=name, folder=folder, valid=stems)
    if not runs:
        raise FileError.of("runs.folder-empty", baqueano_command("experiment"), value=name, folder=folder)
    names = [run.stem for run in runs[-8:]]
    raise FileError.of("runs.unknown", _list_command(folder), value=name, folder=folder, valid=names)


def _list_command(folder: Path | str) -> str:
    """Return the command that a user types to list the runs of a folder."""
    return baqueano_command("runs", "ls", *([] if Path(folder) == Path("runs") else ["--runs", folder]))


def _without_recovered_originals(runs: list[Path]) -> list[Path]:
    """Return the runs, except originals that have a recovered version in the list."""
    names = {run.stem for run in runs}
    return [run for run in runs if run.stem + RECOVERED_SUFFIX not in names]


def find_all(name: str, folder: Path | str = "runs") -> list[Path]:
    """Return the runs that a name selects: a run as in `find`, all runs in a folder, or all runs that match a pattern.
    A pattern contains *, ? or [abc]. `3-28` selects the runs with these numbers, `3-28:2` every second number. A
    recovered run replaces its original.
    Raise FileError if the name does not select a run.
    """
    path = Path(name)
    if path.is_dir() and not (path / "metadata.yaml").exists():
        runs = sorted(path.glob("*.mcap"))
    elif GLOB_LETTERS.search(name) and not path.exists():
        runs = sorted(path.parent.glob(path.name)) if len(path.parts) > 1 else []
        runs = runs or sorted(Path(folder).glob(name if path.suffix else f"{name}.mcap"))
    elif span := NUMBER_RANGE.fullmatch(name):
        first, last, step = int(span[1]), int(span[2]), int(span[3] or 1)
        numbers = range(first, last + 1, max(step, 1))
        runs = [run for run in Path(folder).glob("*.mcap") if run_number(run) in numbers]
        runs.sort(key=number_and_name)
    else:
        return [find(name, folder)]
    runs = _without_recovered_originals(runs)
    if not runs:
        code = "runs.folder-without-runs" if path.is_dir() else "runs.no-match"
        raise FileError.of(code, _list_command(folder), value=name, folder=folder)
    return runs


def reserve_path(folder: Path | str, label: str) -> Path:
    """Return a path as `new_path` does, and reserve its number, so that other programs cannot use it.
    Raise FileError if the folder cannot be created.
    """
    while True:
        path = new_path(folder, label)
        part_path = path.with_name(path.name + ".part")
        try:
            os.close(os.open(part_path, os.O_CREAT | os.O_EXCL, 0o666))
        except FileExistsError:
            continue
        return path


def release_path(path: Path) -> None:
    """Release the number that `reserve_path` reserved; a written run keeps its number."""
    part_path = path.with_name(path.name + ".part")
    with suppress(OSError):
        if part_path.stat().st_size == 0:
            part_path.unlink()
