"""Names that a package imports when they are asked for: what drives a vehicle starts without what only a laptop needs.

A package with a submodule of the same name imports that name at once: else the submodule would take its place.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def on_demand(package: str, names: dict[str, tuple[str, ...]]) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose modules hold these names. It raises AttributeError for any other."""
    module_of = {name: f"{package}.{module}" for module, held in names.items() for name in held}

    def get(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} does not have attribute {name!r}")
        return getattr(import_module(module_of[name]), name)

    return get
