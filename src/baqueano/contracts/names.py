"""Names that the command line, the page and Python share; the command line imports them without numpy."""

from pathlib import Path

STORED_ROUTES = Path("routes")  # the folder of the stored routes
SHAPE_NAMES = (
    "sinuous-circle",
    "circle",
    "eight",
    "rectangle",
    "line",
    "slalom",
    "clothoid",
)  # of guides.shapes.shape
GAINS_CHOICES = ("own", "vehicle")  # of a sweep
