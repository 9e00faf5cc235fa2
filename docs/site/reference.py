"""Generate the API reference from signatures and docstrings of all public names, a page for each module.

In another language the reference has the pages of `import baqueano as bq`, of the contract of a block, of comparisons
and of reports. Their texts are in the catalogue LANGUAGE.po of this folder. They link to the English pages of the other
modules.
"""

import dataclasses
import importlib
import inspect
import io
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from docs.site.docstring import SECTIONS, Translate, markdown

ROOMS = {  # module → its purpose; the first one that offers a name describes it
    "baqueano": "the commands of the command line, as functions",
    "baqueano.vehicle_file": "the file that describes a vehicle",
    "baqueano.vehicles": "models of motion",
    "baqueano.sensors": "models of measurement",
    "baqueano.estimators": "blocks that estimate pose and velocity",
    "baqueano.guides": "blocks that give the pose where the vehicle should be now",
    "baqueano.guides.shapes": "paths of a known shape",
    "baqueano.routes": "preparation and checks of routes before a drive",
    "baqueano.controllers": "blocks that compute the command",
    "baqueano.blocks": "loading of blocks by name, also of your own",
    "baqueano.block_checks": "checks of the rules of blocks",
    "baqueano.worlds": "worlds of a loop: a simulation, a recorded run, a real vehicle",
    "baqueano.worlds.faults": "faults of a simulated world, and the monitors that detect them",
    "baqueano.signals": "the values that blocks exchange",
    "baqueano.contracts": "the protocols of a loop",
    "baqueano.contracts.blocks": "the protocols of the blocks",
    "baqueano.parameter": "parameters of a block, with unit and bounds",
    "baqueano.geometry": "poses, frames, angles",
    "baqueano.symbolic": "compilation and derivatives of plain NumPy",
    "baqueano.drive": "drives of a vehicle: experiment, teach, repeat, replay",
    "baqueano.monitor": "messages during a drive",
    "baqueano.simulate": "simulation of one drive or of many",
    "baqueano.identify": "identification of models",
    "baqueano.validation": "errors of a fit on other runs, and on a drive to come",
    "baqueano.compare": "errors of runs, and consistency of filters",
    "baqueano.sweep": "comparison of blocks on the same drives",
    "baqueano.tune": "tuning of gains",
    "baqueano.report": "pages and figures",
    "baqueano.runs": "runs and routes as files",
    "baqueano.diagnostics": "messages as data, and verdicts",
}
DOOR = "baqueano"
COURSE = (
    DOOR,
    "baqueano.blocks",
    "baqueano.signals",
    "baqueano.contracts.blocks",
    "baqueano.compare",
    "baqueano.report",
)  # for a block of the user, and for what a notebook shows of its results
TITLE = "Reference of the Python names"
INTRODUCTION = (
    "These pages are generated from the code. `help(bq.repeat)` shows the same text. Pages for a course exist in "
    "English and Spanish. The pages of other modules are for programmers, and exist in English only."
)
MODULES = re.compile(r"\b(?:[a-z_]\w*\.)+(?=\w)")
WORDS = {*SECTIONS, "Examples", "Notes", "References", "module", "content"}  # other words alone are types
LONG = 24  # letters of the longest default value that is shown


def reference(language: str = "en", translate: Translate | None = None) -> dict[str, str]:
    """Return the text of each page by its name; each object is described once."""
    translate = translate or translation(language)
    names = [name for name in ROOMS if language == "en" or name in COURSE]
    page_of_object: dict[int, str] = {}
    pages = {f"reference/{_file(name)}": _page(name, page_of_object, translate, language) for name in names}
    rows = "".join(
        f"| [{name}]({_address(name, language)}) | {translate(about)} |\n" for name, about in ROOMS.items()
    )
    tree = "\n".join(map(_file, names))
    pages["reference/index"] = (
        f"# {translate(TITLE)}\n\n{translate(INTRODUCTION)}\n\n"
        f"| {translate('module')} | {translate('content')} |\n|---|---|\n{rows}\n"
        f"```{{toctree}}\n:hidden:\n\n{tree}\n```\n"
    )
    return pages


def catalogue_file(language: str) -> Path:
    """Return the catalogue of the texts of the reference in another language than English."""
    return Path(__file__).with_name(f"{language}.po")


def translation(language: str) -> Translate:
    """Return the function that translates a text of the reference; it raises KeyError for a text without entry."""
    if language == "en":
        return str
    from babel.messages.pofile import read_po

    catalogue = read_po(io.BytesIO(catalogue_file(language).read_bytes()), locale=language)
    texts = {entry.id: str(entry.string) for entry in catalogue if entry.id and not entry.fuzzy}
    return lambda text: texts[text] if _is_translated(text) else text


def texts_to_translate() -> list[str]:
    """Return the texts of the reference in another language than English."""
    texts: list[str] = []

    def collect(text: str) -> str:
        texts.append(text)
        return text

    reference("", collect)
    return [text for text in texts if _is_translated(text)]


def _is_translated(text: str) -> bool:
    return " " in text or text in WORDS


def _file(module: str) -> str:
    return module.removeprefix("baqueano.")


COMMON = "reference/index", *(f"reference/{_file(module)}" for module in COURSE)  # pages in all languages


def _address(module: str, language: str) -> str:
    """Return the target of a link from a page of the reference to the page of a module."""
    is_here = language == "en" or module in COURSE
    return f"{_file(module)}.md" if is_here else f"en:../reference/{_file(module)}.html"


def _page(name: str, page_of_object: dict[int, str], translate: Translate, language: str) -> str:
    module = importlib.import_module(name)
    about = translate(ROOMS[name])
    parts = [
        f"# {name}\n\n{about[0].upper()}{about[1:]}.\n",
        markdown(inspect.getdoc(module) or "", translate),
    ]
    for word in public(module):
        thing = getattr(module, word)
        if inspect.ismodule(thing):
            parts.append(f"`{word}`: [{translate('its page')}]({_address(thing.__name__, language)})\n")
        elif id(thing) in page_of_object and callable(thing):
            target_name = page_of_object[id(thing)]
            parts.append(f"`{word}` → {{py:obj}}`{target_name}`\n")
        elif callable(thing):
            page_of_object[id(thing)] = f"{name}.{word}"
            parts.append(_entry(f"{name}.{word}", thing, translate))
    return "\n".join(parts)


def public(module: ModuleType) -> list[str]:
    """Return the names of `__all__`, or the public classes and functions that the module defines."""
    if names := getattr(module, "__all__", None):
        return sorted(names, key=str.lower)
    return [
        name
        for name, thing in vars(module).items()
        if not name.startswith("_")
        and callable(thing)
        and getattr(thing, "__module__", "") == module.__name__
    ]


def _entry(name: str, thing: Any, translate: Translate) -> str:
    """Return the description of a function or class."""
    text = inspect.getdoc(thing) or ""
    equations = _equations(name, thing, text, translate)
    if not inspect.isclass(thing):
        return _directive("function", name + signature(thing), markdown(text, translate) + equations)
    is_dataclass = dataclasses.is_dataclass(thing) and text.startswith(
        f"{thing.__name__}("
    )  # by Python, not by a person
    body = ["" if is_dataclass else markdown(text, translate) + equations, *_parameters(thing, translate)]
    body += [_directive("method", word + signature(method, True), markdown(text, translate), 3)
             for word, method, text in _methods(thing)]  # fmt: skip
    protocol = getattr(thing, "_is_protocol", False)
    return _directive("class", name + ("" if protocol else signature(thing)), "\n".join(body), 4)


def _equations(name: str, thing: Any, text: str, translate: Translate) -> str:
    """Return the equations of another module than that of the page, if the docstring refers to them by their number."""
    module = inspect.getmodule(thing)
    if "of the module" not in text or module is None or name.startswith(f"{module.__name__}."):
        return ""
    return f"\n**`{module.__name__}`**\n\n{markdown(inspect.getdoc(module) or '', translate)}"


def _directive(kind: str, head: str, body: str, ticks: int = 4) -> str:
    fence = "`" * (ticks + 1)
    return f"{fence}{{py:{kind}}} {head}\n\n{body.strip()}\n{fence}\n"


def signature(thing: Any, method: bool = False) -> str:
    """Return arguments with their types, without modules; a long default is omitted."""
    try:
        signature_of = inspect.signature(thing)
    except (TypeError, ValueError):
        return "()"
    words, has_star = [], False
    for k, parameter in enumerate(signature_of.parameters.values()):
        if method and k == 0 and parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not has_star:
            words.append("*")
        has_star = has_star or parameter.kind in (parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL)
        mark = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        text = f"{mark}{parameter.name}"
        if kind := _type(parameter.annotation):
            text += f": {kind}"
        if parameter.default is not parameter.empty:
            text += f" = {_default(parameter.default)}"
        words.append(text)
    kind = _type(signature_of.return_annotation)
    return f"({', '.join(words)})" + (f" -> {kind}" if kind and not inspect.isclass(thing) else "")


def _type(annotation: Any) -> str:
    if annotation is inspect.Signature.empty:
        return ""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    text = MODULES.sub("", text.replace('"', "").replace("'", ""))
    return text if len(text) < 80 and "<" not in text and "ForwardRef" not in text else ""


def _default(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= LONG and "<" not in text and "\n" not in text else "..."


def _parameters(thing: Any, translate: Translate) -> Iterator[str]:
    """Yield the table of the fields of a block, from the metadata that the loader of vehicle files reads."""
    if not dataclasses.is_dataclass(thing):
        return
    rows = [
        f"| `{field.name}` | {parameter.unit.replace('|', '')} | {markdown(parameter.meaning, translate).strip()} |"
        for field in dataclasses.fields(thing)
        if (parameter := field.metadata.get("parameter")) is not None
    ]
    if rows:
        yield "\n".join(["", "| parameter | unit | meaning |", "|---|---|---|", *rows, ""])


def _methods(thing: type) -> Iterator[tuple[str, Any, str]]:
    """Yield the public methods that have a docstring, also an inherited one."""
    for word in dir(thing):
        method = inspect.getattr_static(thing, word)
        method = getattr(method, "__func__", method)
        if word.startswith("_") or not inspect.isfunction(method):
            continue
        if method.__module__.startswith("baqueano") and (text := inspect.getdoc(getattr(thing, word))):
            yield word, method, text
