"""Ready vehicle files, shipped with the package, named without path or ending: `load("small")`."""

from pathlib import Path

from baqueano.blocks import closest
from baqueano.errors import FileError

FOLDER = Path(__file__).parents[1] / "garage"


def names() -> tuple[str, ...]:
    """The vehicles of the garage."""
    return tuple(sorted(p.stem for p in FOLDER.glob("*.toml")))


def holds(path: Path) -> bool:
    """Whether the file is one of the garage, not one of the user's."""
    return path.parent == FOLDER


def path_of(source: str | Path) -> Path:
    """The file that `source` means: a path, or a name of the garage."""
    path = Path(source).expanduser()
    if path.is_dir():
        inside = sorted(p.name for p in path.glob("*.toml"))
        raise FileError(f"{path} is a folder, expected a vehicle file.{_files(inside)}")
    if path.is_file():
        return path.resolve()
    named = isinstance(source, str) and path.suffix != ".toml" and len(path.parts) == 1
    if named and source in names():
        return FOLDER / f"{source}.toml"
    if named:
        raise FileError(
            f'There is no vehicle "{source}" in the garage: it has '
            f"{', '.join(names())}.{closest(str(source), names())} "
            f"A file of your own ends in .toml."
        )
    beside = sorted(p.name for p in path.parent.glob("*.toml")) if path.parent.is_dir() else []
    raise FileError(
        f"{path}: no such vehicle file.{_files(beside)}{closest(path.name, beside)} `baqueano new` writes "
        "one; the "
        f"garage has {', '.join(names())}."
    )


def _files(found: list[str]) -> str:
    return f" There is {', '.join(found[:8])}." if found else ""
