"""The code of what is said, in place of its words."""

from collections.abc import Callable
from typing import Any


def of_code(code: str, **figures: Any) -> Callable[[Any], bool]:
    """Return a check of an error: it says this code, with these figures among others."""
    return lambda error: error.diagnostic.code == code and figures.items() <= error.diagnostic.figures.items()
