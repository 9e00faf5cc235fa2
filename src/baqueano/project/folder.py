"""Make the folder of a new project with `new`."""

import re
import zlib
from importlib.resources import files
from pathlib import Path

import numpy as np

from baqueano.contracts.calls import checked_call
from baqueano.errors import UsageError
from baqueano.messages.language import translate as _
from baqueano.messages.printable import baqueano_command
from baqueano.parameter import TERM_ROLES, all_parameters
from baqueano.project.notebook import notebook
from baqueano.vehicle_file import VehicleFile, load, parse
from baqueano.vehicle_file.garage import names

BLOCKS = ("my_estimator.py", "my_guide.py", "my_controller.py")
NOTEBOOK = "first_evening.ipynb"
# for each vehicle of the garage, the values that a user would guess
GUESS_FOLDER = Path(__file__).parent / "guesses"
TRUTH_FILE = "simulated.toml"
GUESS_ERROR_STD = 0.15  # standard deviation of ln(true value / guess) in a simulation
FITTED_ROLES = ("free", "gain", *TERM_ROLES)  # roles of parameters
# the docstrings and the comments of a block, which are written in the current language
BLOCK_TEXT = re.compile(r'(?<=""")(?=\S)[^"]+(?=""")|(?<=# ).+')
GUESS_TEMPLATE = """{text}

# {advice}
[provenance.model]
run = "baqueano new, from {name}"
verdict = "GUESS"
"""


@checked_call('bq.new("mylab")')
def new(folder: str | Path, vehicle: str | Path = "small") -> Path:
    """Make a project folder: a vehicle file, example blocks (estimator, guide, controller), and a notebook.

    Parameters
    ----------
    folder : path
        The folder to make: empty or absent.
    vehicle : str or path
        Name of a vehicle of the garage, or a file. For a name, the vehicle file contains guesses, and the vehicle of
        the garage is simulated. For a file of guesses, a second file with a simulated vehicle is written.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    UsageError
        If the folder is not empty.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as somewhere:
    ...     print(*sorted(path.name for path in new(f"{somewhere}/mylab").iterdir()))
    first_evening.ipynb my_controller.py my_estimator.py my_guide.py vehicle.toml
    """
    folder = Path(folder)
    if folder.exists() and any(folder.iterdir()):
        base = folder if folder.name.strip(".") else folder / "mylab"  # "." and ".." cannot have a number
        candidates = (base, *(Path(f"{base}-{k}") for k in range(2, 1000)))
        command = baqueano_command("new", str(next(path for path in candidates if not path.exists())))
        raise UsageError.of("cli.folder-not-empty", command, folder=folder)
    vehicle_file = first_guess(vehicle)
    folder.mkdir(parents=True, exist_ok=True)
    if vehicle_file.is_guess and vehicle_file.simulation.truth not in names():
        with_other_truth(vehicle_file).save(folder / TRUTH_FILE)
        vehicle_file = with_truth(vehicle_file)
    vehicle_file.save(folder / "vehicle.toml")
    for block in BLOCKS:
        text = files("baqueano.project").joinpath(block).read_text(encoding="utf-8")
        text = BLOCK_TEXT.sub(lambda match: _(match[0]), text)
        (folder / block).write_text(text, encoding="utf-8", newline="\n")
    (folder / NOTEBOOK).write_text(notebook(folder.name), encoding="utf-8", newline="\n")
    return folder


def with_truth(vehicle_file: VehicleFile) -> VehicleFile:
    """Return the file with the vehicle of the file TRUTH_FILE, in the same folder, as the truth of its simulation."""
    text = (
        vehicle_file.text if "[simulation]" in vehicle_file.text else f"{vehicle_file.text}\n[simulation]\n"
    )
    text = re.sub(r"^truth *=.*\n", "", text, flags=re.MULTILINE)
    text = text.replace(
        "[simulation]\n",
        f'[simulation]\ntruth = "{TRUTH_FILE}"   # {_("a fit should find its numbers")}\n',
        1,
    )
    return parse(text, vehicle_file.label, vehicle_file.path, vehicle_file.layers, vehicle_file.on_disk)


def with_other_truth(vehicle_file: VehicleFile) -> VehicleFile:
    """Return a vehicle in which each fitted parameter is the guess times exp N(0, GUESS_ERROR_STD²), within its bounds.

    >>> mine = load("small")
    >>> other = with_other_truth(mine)
    >>> bool(np.all(other.value("model.friction.linear") != mine.value("model.friction.linear")))
    True
    """
    rng, truth = np.random.default_rng(zlib.crc32(vehicle_file.name.encode())), vehicle_file.truth
    values: dict[str, object] = {}
    for key, p in all_parameters(truth.vehicle, "model"):
        if p.role in FITTED_ROLES:
            guess = np.asarray(truth.value(key), float)
            value = (guess * np.exp(GUESS_ERROR_STD * rng.standard_normal(guess.shape))).round(6)
            values[key] = np.clip(value, p.low, p.high).tolist()
    return truth.with_values(values)


def localise(vehicle_file: VehicleFile) -> VehicleFile:
    """Return a file of guesses with its comments and its `match` in the current language."""
    text = re.sub(r"# (.*)", lambda comment: f"# {_(comment[1])}", vehicle_file.text)
    text = re.sub(r'^about = "(.*)"', lambda match: f'about = "{_(match[1])}"', text, flags=re.MULTILINE)
    return parse(text, vehicle_file.label, vehicle_file.path, vehicle_file.layers, vehicle_file.on_disk)


def first_guess(vehicle: str | Path = "small") -> VehicleFile:
    """Return the first vehicle file of a project.

    For a vehicle of the garage, it contains guesses. Another file keeps its values; if a fit did not measure them, they
    are marked as guesses.

    >>> guess = first_guess("small")
    >>> guess.is_guess, guess.truth.path is None, guess.value("model.drivetrain.gain").tolist()
    (True, True, [1.0, 1.0])
    """
    vehicle_file = load(vehicle)
    if vehicle_file.path is None:
        return localise(load(GUESS_FOLDER / vehicle_file.label))
    if not vehicle_file.is_guess or "model" in vehicle_file.provenance:
        return vehicle_file
    advice = _(
        "The vehicle is not measured yet. `baqueano identify last --update` writes measured values below."
    )
    text = GUESS_TEMPLATE.format(text=vehicle_file.text.rstrip("\n"), name=vehicle_file.name, advice=advice)
    return parse(text, vehicle_file.label, vehicle_file.path, vehicle_file.layers, vehicle_file.on_disk)
