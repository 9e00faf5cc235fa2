"""Import names of a package at their first use: a vehicle starts without modules that only a laptop needs.

A package imports a name at once if a submodule has the same name: otherwise the submodule would replace it. In the
package baqueano some functions and subpackages have the same name; there `front_door` keeps the name for the function.
A package calls a function of a higher package by `registered_function`: the package baqueano, above all, registers it.
This module imports only `sys` at its start, so that `import baqueano` is fast.
"""

import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

_modules: "dict[str, str]" = {}  # the module of each registered name


def register(module: str, *names: str) -> None:
    """Let any package suggest `names` of `module`, and call them. The module is imported at the first call."""
    _modules.update(dict.fromkeys(names, module))


def registered_function(name: str) -> "Callable[..., Any]":
    """Return the registered function `name`, of a package above the caller."""
    from importlib import import_module

    return getattr(import_module(_modules[name]), name)


def on_demand(
    package: str, names: dict[str, tuple[str, ...]], subpackages: tuple[str, ...] = ()
) -> "Callable[[str], object]":
    """Return the `__getattr__` of a package: it imports names of its modules and its subpackages `subpackages`.

    "name as other" exports `name` under the name `other`. The function raises AttributeError for an unknown name.
    """
    module_by_name = {name: f"{package}.{module}" for module, exports in names.items() for name in exports}
    module_and_name = {
        name.partition(" as ")[2] or name: (module, name) for name, module in module_by_name.items()
    }

    def get(name: str) -> object:
        from importlib import import_module

        if name in subpackages:
            return import_module(f"{package}.{name}")
        if name not in module_and_name:
            suggestion = _suggestion(name, [*module_and_name, *subpackages])
            raise AttributeError(_no_such_name(package, name) + suggestion)
        module, export = module_and_name[name]
        return getattr(import_module(module), export.partition(" as ")[0])

    return get


def unknown_names(package: str) -> "Callable[[str], object]":
    """Return the `__getattr__` of a module that imports all its names: it suggests a name, or an import to type."""

    def get(name: str) -> object:
        module = sys.modules[package]
        submodules = [n for n, x in vars(module).items() if getattr(x, "__name__", "") == f"{package}.{n}"]
        names = [*module.__all__, *sorted({*submodules} - {*module.__all__})]
        raise AttributeError(_no_such_name(package, name) + _suggestion(name, names))

    return get


def _no_such_name(package: str, name: str) -> str:
    if name.startswith("_"):  # Python itself looks it up
        return f"{package}.{name}"
    from baqueano.messages.language import translate as _

    return _("module {package} does not have attribute {name}", package=repr(package), name=repr(name))


def _suggestion(name: str, names: "list[str]") -> str:
    """Return a sentence with the import of a registered name, or with the most similar name. Return "" for names that
    Python itself looks up.
    """
    if name.startswith("_"):
        return ""
    from baqueano.diagnostics import nearest, note
    from baqueano.messages import text

    if name in _modules:
        return f". {text(note('front.advice', fix=f'from {_modules[name]} import {name}'))}"
    return f". {text(nearest(name, names))}."


def front_door(
    package: str, names: dict[str, tuple[str, ...]], subpackages: tuple[str, ...]
) -> "Callable[[str], object]":
    """Return the `__getattr__` of `on_demand` for a package in which submodules and functions have the same names.

    The name always refers to the function, even after an import of the submodule.
    """
    exported_names = {name.partition(" as ")[2] or name for exports in names.values() for name in exports}
    module = type(sys)

    class FrontDoor(module):
        """A module that does not bind a submodule with the name of a function."""

        def __setattr__(self, name: str, value: object) -> None:
            if not (name in exported_names and isinstance(value, module)):
                super().__setattr__(name, value)

    sys.modules[package].__class__ = FrontDoor
    return on_demand(package, names, subpackages)
