"""`new` makes the folder of a project."""

from importlib.resources import files
from pathlib import Path

from baqueano.diagnostics import fault
from baqueano.errors import UsageError
from baqueano.printable import typed
from baqueano.project.notebook import notebook
from baqueano.vehicle_file import VehicleFile, load, parse

BLOCKS = ("my_estimator.py", "my_guide.py", "my_controller.py")
NOTEBOOK = "first_evening.ipynb"
GUESSED = (
    Path(__file__).parent / "guesses"
)  # of the vehicles of the garage, what a person would write of them
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
        The vehicle with which it begins: a name of the garage, whose project holds guesses and simulates the one
        of the garage, or a file.

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
    file = guess_of(vehicle)
    folder.mkdir(parents=True, exist_ok=True)
    file.save(folder / "vehicle.toml")
    for block in BLOCKS:
        text = files("baqueano.project").joinpath(block).read_text(encoding="utf-8")
        (folder / block).write_text(text, encoding="utf-8", newline="\n")
    (folder / NOTEBOOK).write_text(notebook(folder.name), encoding="utf-8", newline="\n")
    return folder


def guess_of(vehicle: str | Path = "small") -> VehicleFile:
    """The file that a project begins with: of a vehicle of the garage, guesses; of another file its own numbers,
    marked as guesses unless a fit measured them.

    >>> guess = guess_of("small")
    >>> guess.guessed, guess.truth.path is None, guess.value("model.drivetrain.gain").tolist()
    (True, True, [1.0, 1.0])
    """
    file = load(vehicle)
    if file.path is None:
        return load(GUESSED / file.label)
    if not file.guessed or "model" in file.provenance:
        return file
    text = GUESSES.format(text=file.text.rstrip("\n"), name=file.name)
    return parse(text, file.label, file.path, file.layers, file.on_disk)
