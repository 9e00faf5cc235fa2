"""Names that the command line, the page and Python share; the command line imports them without numpy."""

from pathlib import Path

STORED_ROUTES = Path("routes")  # the folder of the stored routes
# of guides.shapes.shape
SHAPE_NAMES = ("sinuous-circle", "circle", "eight", "rectangle", "line", "slalom", "clothoid")
GAINS_CHOICES = ("own", "vehicle")  # of a sweep
