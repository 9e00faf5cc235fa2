"""Names that a package imports when they are asked for: what drives a vehicle starts without what only a laptop needs.

A package with a submodule of the same name imports that name at once: else the submodule would take its place. The
front door has verbs that are called as the rooms in which they stand: there `front_door` keeps the place for the verb.

It imports nothing itself, so that `import baqueano` takes no time.
"""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable


def on_demand(
    package: str, names: dict[str, tuple[str, ...]], rooms: tuple[str, ...] = ()
) -> "Callable[[str], object]":
    """The `__getattr__` of a package whose modules hold these names, "name as other" under another name, and of its
    subpackages `rooms`. It raises AttributeError for any other."""
    module_of = {name: f"{package}.{module}" for module, exports in names.items() for name in exports}
    places = {name.partition(" as ")[2] or name: (module, name) for name, module in module_of.items()}

    def get(name: str) -> object:
        from importlib import import_module

        if name in rooms:
            return import_module(f"{package}.{name}")
        if name not in places:
            raise AttributeError(f"module {package!r} does not have attribute {name!r}")
        module, export = places[name]
        return getattr(import_module(module), export.partition(" as ")[0])

    return get


def front_door(
    package: str, names: dict[str, tuple[str, ...]], rooms: tuple[str, ...]
) -> "Callable[[str], object]":
    """`on_demand`, for a package some of whose submodules are called as one of the names: the name is never the
    submodule, also after that was imported."""
    verbs = {name.partition(" as ")[2] or name for exports in names.values() for name in exports}
    module = type(sys)

    class FrontDoor(module):
        """A module to which a submodule of a verb's name is not bound."""

        def __setattr__(self, name: str, value: object) -> None:
            if not (name in verbs and isinstance(value, module)):
                super().__setattr__(name, value)

    sys.modules[package].__class__ = FrontDoor
    return on_demand(package, names, rooms)
