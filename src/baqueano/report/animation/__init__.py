"""Show a run as an animation: one SVG file without a script.

It does not move for a reader who has switched off animations.
"""

from pathlib import Path

from baqueano.diagnostics import fault
from baqueano.errors import UsageError


def picture_file(path: str | Path) -> Path:
    """Return the path of the picture to write. Raise UsageError if its file extension is not .svg."""
    path = Path(path)
    if path.suffix.lower() != ".svg":
        fix = str(path.with_suffix(".svg"))
        raise UsageError.of("report.animation-ending", f"--animation {fix}", value=str(path))
    return path
