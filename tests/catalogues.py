"""The catalogues of other languages, for gettext: the texts to translate, and a check that all are translated.

`make catalogues` reads the templates of messages, the help of the command line, and the texts of click. It also reads
the texts in `_(…)` and `N_(…)` of the source. It updates src/baqueano/locale/*/LC_MESSAGES/baqueano.po and compiles it.
It also updates docs/site/*.po, with the docstrings of `import baqueano as bq` for the site.
An entry is fuzzy if its English text changed: translate it again and remove the mark.
"""

import ast
import io
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Formatter

import click
from babel.messages import Catalog
from babel.messages.catalog import Message
from babel.messages.extract import extract_from_file
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po

from baqueano.cli import baqueano
from baqueano.cli.subcommands import SUBCOMMANDS, load_command
from baqueano.identify.parameters.free import AXIS_NAMES, ORDINALS
from baqueano.messages import templates
from baqueano.messages.language import CATALOGUES, DOMAIN, LANGUAGES
from baqueano.project.folder import BLOCK_TEXT
from docs.site.reference import catalogue_file, texts_to_translate
from tests.syntax import nodes_of, python_files

SOURCE = CATALOGUES.parent
KEYS_PAGE = SOURCE.parents[1] / "docs" / "vehicle_file_keys.py"
OF_CLICK = {"_": None, "ngettext": (1, 2)}
OF_PARAMETERS = {"shown_by", "measured_by", "label", "term"}
COMMENT = re.compile(r'# (.*)|^about = "(.*)"', re.MULTILINE)
CODE = re.compile(
    rf"`[^`\n]+`|--[a-z][a-z-]+|baqueano (?:{'|'.join(SUBCOMMANDS)})\b|\[[a-z_]{{3,}}(?:\.[a-z_]+)*\](?!\()"
)
MARKERS = {"_": 0, "N_": 0, "parameter": 1}  # function → argument that contains text


def places(language: str) -> tuple[Path, Path]:
    """Return the files .po and .mo of a language."""
    folder = CATALOGUES / language / "LC_MESSAGES"
    return folder / f"{DOMAIN}.po", folder / f"{DOMAIN}.mo"


def required_catalogue() -> Catalog:
    """Return all texts that must be translated."""
    catalogue = Catalog(
        project="baqueano", charset="utf-8", copyright_holder="The baqueano developers", fuzzy=False
    )
    for code, template in sorted(templates().items()):
        catalogue.add(template, context=code)
    for words in help_of(baqueano):
        catalogue.add(words)
    for words in SUBCOMMANDS.values():
        catalogue.add(words)
    for path in (*python_files(SOURCE), KEYS_PAGE):
        for words in words_in(path):
            catalogue.add(words)
    for path in sorted((SOURCE / "project").glob("my_*.py")):
        for words in BLOCK_TEXT.findall(path.read_text(encoding="utf-8")):  # as `baqueano new` writes it
            catalogue.add(words)
    for path in sorted((SOURCE / "project" / "guesses").glob("*.toml")):
        for words in COMMENT.findall(path.read_text(encoding="utf-8")):
            catalogue.add("".join(words))
    for path in Path(click.__file__).parent.glob("*.py"):
        for _, words, _, _ in extract_from_file("python", path, keywords=OF_CLICK):
            catalogue.add(words)
    return catalogue


def required_reference() -> Catalog:
    """Return all texts of the reference of Python names that must be translated."""
    catalogue = Catalog(
        project="baqueano", charset="utf-8", copyright_holder="The baqueano developers", fuzzy=False
    )
    for words in texts_to_translate():
        catalogue.add(words)
    return catalogue


def words_in(path: Path) -> Iterator[str]:
    """Yield what is marked in a file: literals in `_(…)` and `N_(…)`, also in f-strings, and words of parameters."""
    for node in nodes_of(path):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in MARKERS:
            words = [*node.args[MARKERS[node.func.id] :][:1]]
            words += [
                key.value for key in node.keywords if node.func.id == "parameter" and key.arg in OF_PARAMETERS
            ]
            for element in (text for word in words for text in getattr(word, "elts", [word])):
                if isinstance(element, ast.Constant) and element.value:
                    yield from words_in_braces(element.value)


def words_in_braces(words: str) -> list[str]:
    """Return words of a parameter for each of its entries: `{nth}` and `{axis}` are replaced by their names.

    >>> words_in_braces("the {nth} motor")
    ['the first motor', 'the second motor']
    """
    names = {"{nth}": ORDINALS[:2], "{axis}": AXIS_NAMES}
    return next(
        ([words.replace(field, name) for name in word] for field, word in names.items() if field in words),
        [words],
    )


def help_of(command: click.Command) -> Iterator[str]:
    """Yield the help of a command, of its options, and of the commands below it."""
    yield from filter(
        None, (command.help, command.short_help, command.epilog, *getattr(command, "groups", ()))
    )
    yield from (param.help for param in command.params if isinstance(param, click.Option) and param.help)
    commands = [*getattr(command, "commands", {}).values()]
    for verb in map(load_command, SUBCOMMANDS) if command is baqueano else commands:
        yield from help_of(verb)


def read_catalogue(language: str, path: Path | None = None) -> Catalog:
    """Return the catalogue of a language as its file contains it; by default that of the package."""
    path = path or places(language)[0]
    if not path.exists():
        return Catalog(locale=language, charset="utf-8", fuzzy=False)
    return read_po(io.BytesIO(path.read_bytes()), locale=language)


def compiled(catalogue: Catalog) -> bytes:
    """Return what gettext reads."""
    out = io.BytesIO()
    write_mo(out, catalogue)
    return out.getvalue()


def update(language: str, path: Path, entries: Catalog) -> Catalog:
    """Write a catalogue again, with all texts that must be translated at present."""
    catalogue = read_catalogue(language, path)
    creation_time = catalogue.creation_date  # a file with equal entries is not changed
    catalogue.update(entries, no_fuzzy_matching=False, update_header_comment=False)
    catalogue.creation_date = creation_time
    catalogue.obsolete.clear()
    path.parent.mkdir(parents=True, exist_ok=True)
    out = io.BytesIO()
    write_po(out, catalogue, width=120, sort_output=True, omit_header=False)
    path.write_bytes(out.getvalue())
    return catalogue


def faults(catalogue: Catalog, entries: Catalog | None = None) -> list[str]:
    """Return the entries that are missing, superfluous, fuzzy, or have other placeholders than the English text."""
    entries = required_catalogue() if entries is None else entries
    failures = [
        f"superfluous: {name_of(entry)}"
        for entry in catalogue
        if entry.id and entries.get(entry.id, entry.context) is None
    ]
    for message in entries:
        if not message.id:
            continue
        entry = catalogue.get(message.id, message.context)
        name = name_of(message)
        if entry is None or not all(entry.string if isinstance(entry.string, tuple) else (entry.string,)):
            failures.append(f"missing: {name}")
        elif entry.fuzzy:
            failures.append(f"fuzzy: {name}")
        elif (difference := differs(message.id, entry.string)) is not None:
            failures.append(f"placeholders: {name}: {difference}")
    return failures


def name_of(entry: Message) -> str:
    """Return the code, if any, and the English text of an entry."""
    return f"{entry.context or ''} {entry.id!r}".strip()


def differs(english: str | tuple[str, ...], translation: str | tuple[str, ...]) -> str | None:
    """Return the placeholders, or the code, of both where they are not the same; None where they are."""
    if isinstance(english, tuple):
        pairs = zip(english, translation, strict=True)
        return next((difference for pair in pairs if (difference := differs(*pair)) is not None), None)
    for fields_of in (fields, code):
        source_fields, translated_fields = fields_of(english), fields_of(translation)
        if source_fields != translated_fields:
            return f"{sorted(source_fields)} and {sorted(translated_fields)}"
    return None


def code(words: str) -> set[str]:
    """Return the parts that a user types: spans in backticks, options, verbs, tables of a file.

    >>> sorted(code("Fit it: baqueano identify RUNS --update, and write [simulation] and `truth`."))
    ['--update', '[simulation]', '`truth`', 'baqueano identify']
    """
    return set(CODE.findall(words))


def fields(template: str) -> set[str]:
    """Return the names of a template's fields, nested ones too.

    >>> sorted(fields("{arg[use]:{sensor}} of {x:.3g}"))
    ['arg[use]', 'sensor', 'x']
    """
    try:
        fields_of_template = list(Formatter().parse(template))
    except ValueError:
        return set()
    names = {name for _, name, _, _ in fields_of_template if name is not None}
    return names.union(*(fields(spec) for _, _, spec, _ in fields_of_template if spec))


if __name__ == "__main__":
    to_do = 0
    for language in LANGUAGES:
        if language != "en":
            po, mo = places(language)
            for path, entries in (
                (po, required_catalogue()),
                (catalogue_file(language), required_reference()),
            ):
                faulty = faults(update(language, path, entries), entries)
                print(f"{path}: {len(faulty)} to do", *faulty, sep="\n  ")
                to_do += len(faulty)
            mo.write_bytes(compiled(read_catalogue(language)))
    sys.exit(bool(to_do))
