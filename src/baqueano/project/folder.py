"""`new` makes the folder of a project."""

from importlib.resources import files
from pathlib import Path

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.printable import typed
from baqueano.project.notebook import notebook
from baqueano.vehicle_file import VehicleFile, garage_names, load, parse

BLOCKS = ("my_estimator.py", "my_guide.py", "my_controller.py")
NOTEBOOK = "first_evening.ipynb"
GUESSES = """{text}

# Nobody measured your vehicle yet. `baqueano identify last --update` writes what it measures below this table.
[provenance.model]
run = "baqueano new, from {name}"
verdict = "GUESS"
"""


def new(folder: str | Path, vehicle: str | Path = "small") -> Path:
    """Make a project folder: a vehicle file, an estimator, a guide and a controller of one's own, and a notebook.

    Parameters
    ----------
    folder : path
        Where to make it; an empty or absent folder.
    vehicle : str or path
        The vehicle with which it begins: a name of the garage, or a file.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    UsageError
        Where the folder is not empty.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as somewhere:
    ...     print(*sorted(path.name for path in new(f"{somewhere}/mylab").iterdir()))
    first_evening.ipynb my_controller.py my_estimator.py my_guide.py vehicle.toml
    """
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(fault("cli.folder-not-empty", typed("new", f"{folder}-2"), folder=folder))
    file = as_guess(load(vehicle))
    folder.mkdir(parents=True, exist_ok=True)
    file.save(folder / "vehicle.toml")
    for block in BLOCKS:
        text = files("baqueano.project").joinpath(block).read_text(encoding="utf-8")
        (folder / block).write_text(text, encoding="utf-8", newline="\n")
    truth = str(vehicle) if str(vehicle) in garage_names() else "vehicle.toml"
    (folder / NOTEBOOK).write_text(notebook(folder.name, truth), encoding="utf-8", newline="\n")
    return folder


def as_guess(file: VehicleFile) -> VehicleFile:
    """The file, and in it that the numbers of its model are guesses; one with numbers of a fit as it is."""
    if not file.guessed or "model" in file.provenance:
        return file
    text = GUESSES.format(text=file.text.rstrip("\n"), name=file.name)
    return parse(text, file.label, file.path, file.layers, file.on_disk)
