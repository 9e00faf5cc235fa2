"""Provide the vehicle files of the package, named without path or extension: `load("small")`."""

import re
from pathlib import Path

from baqueano.diagnostics import nearest
from baqueano.errors import FileError

GARAGE_FOLDER = Path(__file__).parents[1] / "garage"
MODEL_TABLE = re.compile(rb"^\s*\[\s*model\s*[].]", re.M)  # a map or a route lacks it


def names() -> tuple[str, ...]:
    """Return the names of the vehicles in the garage.

    Returns
    -------
    tuple of str
        In alphabetical order.

    Examples
    --------
    >>> "small" in names()
    True
    """
    return tuple(sorted(p.stem for p in GARAGE_FOLDER.glob("*.toml")))


def is_in_garage(path: Path) -> bool:
    """Return True if `path` is in the folder of the garage."""
    return path.parent == GARAGE_FOLDER


def resolve_path(source: str | Path) -> Path:
    """Return the path of `source`: a path, or a name of the garage. Raise FileError if the file does not exist."""
    path = Path(source).expanduser()
    if path.is_file():
        return path.resolve()
    is_run_name = isinstance(source, str) and path.suffix != ".toml" and len(path.parts) == 1
    if is_run_name and source in names():  # even beside a folder of this name
        return GARAGE_FOLDER / f"{source}.toml"
    if path.is_dir():
        file_names = sorted(p.name for p in path.glob("*.toml"))
        if not file_names:
            raise FileError.of("vehicle.folder-empty", "baqueano new mylab", path=path)
        raise FileError.of("vehicle.folder", path=path, files=file_names)
    neighbours = _vehicle_files(path.parent)
    if is_run_name:
        suggestion = nearest(str(source), [*neighbours, *names()])
        raise FileError.of(
            "vehicle.unknown", "baqueano new mylab", absent_path=path, value=source, suggestion=suggestion
        )
    raise FileError.of(
            "vehicle.absent", "baqueano new mylab", absent_path=path, value=path.name,
            suggestion=nearest(path.name, [*neighbours, *names()]))  # fmt: skip


def _vehicle_files(folder: Path) -> list[str]:
    """Return the names of the vehicle files in a folder, even of those with errors; [] without the folder."""
    paths = sorted(p for p in folder.glob("*.toml") if p.is_file())
    return [p.name for p in paths if MODEL_TABLE.search(p.read_bytes())]
