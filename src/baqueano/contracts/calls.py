"""Check how a function of the front door is called: a wrong call raises one sentence with a call to type.

The check reads the annotations. An annotation that is a class of KINDS, a number or a path is checked; any other
annotation, such as the one of a block, is left to the function. Missing and unknown arguments are found for all.
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from datetime import date
from functools import wraps
from numbers import Integral, Real
from pathlib import Path, PurePath
from typing import NamedTuple, NoReturn, TypeVar, cast

import numpy as np

from baqueano.contracts.blocks import Guide
from baqueano.contracts.names import SHAPE_NAMES, STORED_ROUTES
from baqueano.contracts.values import Tree
from baqueano.diagnostics import nearest
from baqueano.errors import Misuse
from baqueano.messages.language import N_

F = TypeVar("F", bound=Callable[..., Tree])


class ArgumentKind(NamedTuple):
    """The kind of an argument: its name, its test, and lines that read one from a file or make one by name.

    `stored_path` is the path of a file that the user can also give by its name. `made_names` are the names of `maker`.
    """

    name: str
    accepts: Callable[[object], bool]
    reader: str = ""
    maker: str = ""
    stored_path: str = ""
    made_names: Sequence[str] = ()


LIST = N_("a list")
MAX_REPR = 40  # characters of an argument that a message shows
LIBRARIES = {"baqueano", "numpy", "pandas", "polars", "scipy", "torch", "xarray", *sys.stdlib_module_names}
LIBRARIES -= {"types"}  # a SimpleNamespace is of the user


def _has_class(name: str) -> Callable[[object], bool]:
    """Return a test for objects of a class, by its name: the classes belong to packages above this one.

    An object of the user, which only behaves like the class, is accepted.
    """

    def accepts(value: object) -> bool:
        is_library_type = type(value).__module__.partition(".")[0] in LIBRARIES
        return not is_library_type or any(base.__name__ == name for base in type(value).__mro__)

    return accepts


def _is_array(value: Tree) -> bool:
    try:
        return not isinstance(value, str) and np.asarray(value, dtype=float) is not None
    except (TypeError, ValueError):
        return False


KINDS = {  # part of an annotation → the kind
    "VehicleFile": ArgumentKind(N_("a vehicle file"), _has_class("VehicleFile"), "robot = bq.load({})"),
    "Run": ArgumentKind(N_("a run"), _has_class("Run"), "run = bq.read_run({})"),
    "Route": ArgumentKind(
        N_("a route"),
        _has_class("Route"),
        "from baqueano.runs import read_route; route = read_route({})",
        "from baqueano.guides.shapes import shape; route = shape({}, 1.0, 0.25)",
        str(STORED_ROUTES / "{}.csv"),
        SHAPE_NAMES,
    ),
    "Fit": ArgumentKind(N_("a fit"), _has_class("Fit")),
    "FitOptions": ArgumentKind(N_("the options of a fit"), _has_class("FitOptions")),
    "ColumnMap": ArgumentKind(N_("a map"), _has_class("ColumnMap")),
    "Axes": ArgumentKind(N_("axes of matplotlib"), _has_class("Axes")),
    "Figure": ArgumentKind(N_("a figure of matplotlib"), _has_class("Figure")),
    "SubFigure": ArgumentKind(N_("a figure of matplotlib"), _has_class("SubFigure")),
    "date": ArgumentKind(N_("a date"), lambda value: isinstance(value, date)),
    "Guide": ArgumentKind(N_("a guide"), lambda value: isinstance(value, Guide)),
    "int": ArgumentKind(N_("a whole number"), lambda value: isinstance(value, Integral)),
    "float": ArgumentKind(N_("a number"), lambda value: isinstance(value, Real | np.ndarray)),
    "bool": ArgumentKind(N_("True or False"), lambda value: isinstance(value, bool | np.bool_)),
    "str": ArgumentKind(N_("a text"), lambda value: isinstance(value, str)),
    "Path": ArgumentKind(N_("a name or a path"), lambda value: isinstance(value, PurePath)),
    "ndarray": ArgumentKind(N_("an array"), _is_array),
    "dict[str, Any]": ArgumentKind(N_("a dict"), lambda value: isinstance(value, Mapping)),
    "None": ArgumentKind("None", lambda value: value is None),
}


def checked_call(
    example: str, *option_makers: Callable[..., Tree], checked: Sequence[Callable[..., Tree]] = ()
) -> Callable[[F], F]:
    """Return a decorator for a public function; `example` is a call of it that a reader can type.

    `option_makers` and `checked` receive the **options of the function. Their keywords are checked too, and the
    keywords of `option_makers` become part of the signature.

    The decorated function raises Misuse for a missing or unknown argument, for an argument of another kind, and for
    arguments in another order.

    >>> @checked_call("double(2)")
    ... def double(number: int) -> int:
    ...     return 2 * number
    >>> double("2")
    Traceback (most recent call last):
    baqueano.errors.Misuse: double(): number = "2"; expected a whole number. Type: double(2)
    """

    def decorate(function: F) -> F:
        if isinstance(function, type):
            owner: Tree = function
            owner.__init__ = decorate(owner.__init__)
            return owner
        shown_signature = _with_options(inspect.signature(function), option_makers)
        signature = _with_options(shown_signature, checked)
        kinds = {
            name: argument_kinds
            for name, parameter in signature.parameters.items()
            if parameter.kind != parameter.VAR_KEYWORD
            and (argument_kinds := _annotation_kinds(parameter.annotation))
        }
        variadic_names = [p.name for p in signature.parameters.values() if p.kind == p.VAR_POSITIONAL]

        @wraps(function)
        def call(*args: Tree, **options: Tree) -> Tree:
            try:
                values = signature.bind(*args, **options).arguments
            except TypeError:
                _refuse_arguments(signature, example, args, options)
            for name in variadic_names:
                values[name] = (
                    args[0] if len(args) == 1 and not _is_container(args[0]) else flatten_arguments(args)
                )
            wrong_names = [
                n for n in kinds if n in values and not any(k.accepts(values[n]) for k in kinds[n])
            ]
            if wrong_names:
                _refuse_kind(kinds, wrong_names, values, example)
            return function(*args, **options)

        vars(call)["__signature__"] = shown_signature
        return cast(F, call)

    return decorate


def flatten_arguments(arguments: Iterable[Tree]) -> list[Tree]:
    """Return the arguments of a function(*arguments), with the items of each list, dict or generator in its place.

    >>> flatten_arguments([1, [2, 3], {"name": 4}])
    [1, 2, 3, 4]
    """
    items: list[Tree] = []
    for argument in arguments:
        parts = argument.values() if isinstance(argument, Mapping) else argument
        items += list(parts) if _is_container(argument) else [argument]
    return items


def _is_container(value: Tree) -> bool:
    is_record = isinstance(value, tuple) and type(value) is not tuple
    return isinstance(value, Iterable) and not isinstance(value, str) and not is_record


def _with_options(
    signature: inspect.Signature, option_makers: Sequence[Callable[..., Tree]]
) -> inspect.Signature:
    """Return a signature with the keywords of functions, and the fields of classes, instead of **options."""
    if not option_makers:
        return signature
    parameters = {name: p for name, p in signature.parameters.items() if p.kind != p.VAR_KEYWORD}
    for maker in option_makers:
        for name, parameter in inspect.signature(maker).parameters.items():
            if isinstance(maker, type) or parameter.kind == parameter.KEYWORD_ONLY:
                parameters.setdefault(name, parameter.replace(kind=parameter.KEYWORD_ONLY))
    return signature.replace(parameters=list(parameters.values()))


def _annotation_kinds(annotation: object) -> tuple[ArgumentKind, ...]:
    """Return the kinds of an annotation, or () if one of its parts is not in KINDS."""
    text = annotation.__name__ if isinstance(annotation, type) else str(annotation)
    if "_SupportsArray" in text:  # numpy's ArrayLike
        return (KINDS["ndarray"],)
    parts = re.split(r" \| (?![^\[]*\])", re.sub(r"\w+\.", "", text))
    kinds = [_part_kind(part) for part in parts]
    return tuple(kind for kind in kinds if kind) if all(kinds) else ()


def _part_kind(part: str) -> ArgumentKind | None:
    items = re.fullmatch(r"(?:Sequence|Mapping|list|dict)\[(?:str, )?(.*)\]", part)
    if part in KINDS or not items:
        return KINDS.get(part)
    kinds = _annotation_kinds(items[1])
    if not kinds:
        return None

    def accepts(value: object) -> bool:
        if isinstance(value, list | tuple | np.ndarray):
            return all(any(kind.accepts(item) for kind in kinds) for item in value)
        return isinstance(value, Iterable) and not isinstance(value, str)

    kind = kinds[0]._replace(accepts=accepts)
    return kind._replace(name=LIST, reader="{name}=[{}]") if items[1] == "str" else kind


def _call_name(example: str) -> str:
    return example.partition("(")[0]


def _refuse_arguments(
    signature: inspect.Signature, example: str, args: tuple[object, ...], options: Mapping[str, Tree]
) -> NoReturn:
    """Raise Misuse for a call that does not match the signature."""
    parameters = signature.parameters
    unknown = [name for name in options if name not in parameters]
    has_keywords = any(parameter.kind == parameter.VAR_KEYWORD for parameter in parameters.values())
    if unknown and not has_keywords:
        groups = [p for p in parameters.values() if is_dataclass(p.default)]
        for group in groups:
            if unknown[0] in group.default.__dataclass_fields__:
                owner = f"bq.{type(group.default).__name__}"
                fix = f"{group.name}={owner}({unknown[0]}={options[unknown[0]]!r})"
                raise Misuse.of(
                    "call.option-of", fix, call=_call_name(example), value=unknown[0], owner=owner
                )
        suggestion = nearest(unknown[0], [name for name in parameters if name != "self"])
        raise Misuse.of(
            "call.unknown", example, call=_call_name(example), value=unknown[0], suggestion=suggestion
        )
    positional = [p for p in parameters.values() if p.kind == p.POSITIONAL_OR_KEYWORD]
    missing_names = [
        p.name for p in positional[len(args) :] if p.default is p.empty and p.name not in options
    ]
    if missing_names:
        raise Misuse.of("call.missing", example, call=_call_name(example), names=missing_names)
    max_count = len(positional) - ("self" in parameters)
    raise Misuse.of("call.positions", example, call=_call_name(example), maximum=max_count)


def _refuse_kind(
    kinds: Mapping[str, tuple[ArgumentKind, ...]],
    wrong_names: list[str],
    values: Mapping[str, Tree],
    example: str,
) -> NoReturn:
    """Raise Misuse for arguments of another kind, or in another order."""
    name, call = wrong_names[0], _call_name(example)
    value, own_kinds = values[name], kinds[name]
    if any(
        _is_accepted(value, kinds[other]) or _is_accepted(values[other], own_kinds)
        for other in wrong_names[1:]
    ):
        raise Misuse.of("call.order", example, call=call)
    if type(value).__module__.startswith("baqueano"):
        for other in (n for n in kinds if n not in values and _is_accepted(value, kinds[n])):
            fix = f"{other}={_short_repr(value)}"
            raise Misuse.of("call.of-other-argument", fix, call=call, name=name, function=other)
    expected, label = KINDS["Path"] if KINDS["Path"] in own_kinds else own_kinds[0], name
    if (position := _wrong_item(value, own_kinds)) is not None:
        label, value = f"{name}[{position}]", value[position]
        expected = KINDS["str"] if expected.name == LIST else expected
    fix = _fix(name, value, own_kinds, example)
    raise Misuse.of("call.kind", fix, call=call, name=label, value=_value_text(value), expected=expected.name)


def _wrong_item(value: Tree, kinds: tuple[ArgumentKind, ...]) -> int | None:
    """Return the index of the first item of a list that is not accepted; None if the list itself is not accepted."""
    if type(value) not in (list, tuple) or not _is_accepted([], kinds):
        return None
    return next((i for i, item in enumerate(value) if not _is_accepted([item], kinds)), None)


def _fix(name: str, value: Tree, kinds: tuple[ArgumentKind, ...], example: str) -> str:
    """Return the code to type instead of an argument with the value `value`; usually the example of the call."""
    for part_name in (name.removesuffix("s"), name):  # such as the route of the result of `teach`
        if (part := getattr(value, part_name, None)) is not None and _is_accepted(part, kinds):
            return re.sub(rf"\b{part_name}\b", f"result.{part_name}", example)
    if type(value) is float and KINDS["int"] in kinds:
        return f"{example[:-1]}, {name}={max(1, round(value))})"
    if not isinstance(value, str | PurePath):
        return example
    lines = {made_name: kind.maker for kind in kinds for made_name in kind.made_names}
    for kind in kinds:
        stored_files = Path().glob(kind.stored_path.format("*")) if kind.stored_path else ()
        lines |= {path.stem: kind.reader for path in stored_files}
    match = nearest(str(value), lines).figures.get("match")
    if match is None and lines and not PurePath(value).suffix:
        match = next(iter(lines))  # no name is similar: an example
    if match is not None:
        return lines[str(match)].format(_value_text(str(match)), name=name)
    reader = next((kind.reader for kind in kinds if kind.reader), "")
    return reader.format(_value_text(value), name=name) if reader else example


def _value_text(value: object) -> str:
    return f'"{value}"' if isinstance(value, str | PurePath) else _short_repr(value)


def _is_accepted(value: object, kinds: tuple[ArgumentKind, ...]) -> bool:
    return any(kind.accepts(value) for kind in kinds)


def _short_repr(value: object) -> str:
    """Return a number, None or a short list as Python writes it; of a class or any other object its name."""
    if isinstance(value, type):
        return f"class {value.__name__}"
    is_short = (value is None or isinstance(value, Real | list | tuple)) and len(repr(value)) <= MAX_REPR
    return repr(value) if is_short else f"{type(value).__name__}(…)"
