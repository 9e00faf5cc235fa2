"""A run as a moving picture: one SVG file without a script, which stands still for a reader who wants no motion."""

from pathlib import Path

from baqueano.diagnostics import fault
from baqueano.errors import UsageError


def picture_file(path: str | Path) -> Path:
    """Return the path of a picture to be written.  UsageError where it has another ending than .svg."""
    path = Path(path)
    if path.suffix.lower() != ".svg":
        fix = str(path.with_suffix(".svg"))
        raise UsageError(fault("report.animation-ending", f"--animation {fix}", found=str(path)))
    return path
