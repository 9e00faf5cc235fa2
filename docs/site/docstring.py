"""Convert a docstring to Markdown: paragraphs, sections of numpydoc, examples, and indented equations.

`translate` receives each text, without its line breaks, and returns it in the language of the page.
"""

import re
from collections.abc import Callable, Iterator
from textwrap import dedent

SPECIAL = re.compile(r"([\\*_<>\[\]$|#~^{}])")
SET_IN = "  "
RULE = re.compile(r"-{3,}\s*$")
Translate = Callable[[str], str]
SECTIONS = ("Parameters", "Returns", "Raises", "Attributes", "Yields", "Methods", "Other Parameters")


def markdown(docstring: str, translate: Translate = str) -> str:
    """Return the Markdown of a docstring whose indentation is clean (inspect.getdoc)."""
    out = []
    for heading, lines in _sections(docstring.splitlines()):
        if heading:
            out.append(f"**{translate(heading)}**\n")
        out += (_entries if heading in SECTIONS else _blocks)(lines, translate)
    return "\n".join(out).strip() + "\n"


def _sections(lines: list[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield (heading, lines) of each section; the first section does not have a heading."""
    heading, entries = "", list[str]()
    for k, line in enumerate(lines):
        if k + 1 < len(lines) and RULE.fullmatch(lines[k + 1]) and line.strip() and line[0] != " ":
            yield heading, entries
            heading, entries = line.strip(), []
        elif not (RULE.fullmatch(line) and k and lines[k - 1].strip() == heading):
            entries.append(line)
    yield heading, entries


def _entries(lines: list[str], translate: Translate) -> Iterator[str]:
    """Yield a list of the entries of a section: `name : type`, and an indented description."""
    name, content = "", list[str]()

    def entry() -> Iterator[str]:
        if name:
            words, _, kind = name.partition(" : ")
            head = f"`{words.strip()}`" + (f", {escaped(translate(kind.strip()))}" if kind else "")
            text = escaped(translate(_joined(content)))
            yield f"- {head}" + (f": {text}" if text else "")

    for line in lines:
        if line.strip() and line[0] != " ":
            yield from entry()
            name, content = line, []
        else:
            content.append(line)
    yield from entry()
    yield ""


def _blocks(lines: list[str], translate: Translate) -> Iterator[str]:
    """Yield paragraphs, examples, and indented blocks without changes."""
    for part in _paragraphs(lines):
        if part.lstrip().startswith(">>>"):
            yield f"```pycon\n{dedent(part)}\n```\n"
        elif part.startswith(SET_IN):
            yield f"```text\n{dedent(part)}\n```\n"
        elif part.startswith(("- ", "* ")):
            yield "\n".join(_item(line, translate) for line in part.splitlines()) + "\n"
        else:
            yield from _mixed_lines(part.splitlines(), translate)


def _paragraphs(lines: list[str]) -> list[str]:
    """Return the paragraphs, which empty lines separate; successive indented paragraphs are joined."""
    parts = list[str]()
    for part in re.split(r"\n\s*\n", "\n".join(lines).strip("\n")):
        if parts and part.startswith(SET_IN) and parts[-1].startswith(SET_IN):
            parts[-1] += f"\n\n{part}"
        elif part.strip():
            parts.append(part)
    return parts


def _item(line: str, translate: Translate) -> str:
    """Return a line of a list."""
    mark = re.match(r"\s*[-*] |", line)
    assert mark is not None
    return mark.group() + escaped(translate(line[mark.end() :]))


def _mixed_lines(lines: list[str], translate: Translate) -> Iterator[str]:
    """Yield a paragraph whose last lines may be indented: an equation after its sentence."""
    cut = next((k for k, line in enumerate(lines) if line.startswith(SET_IN)), len(lines))
    if cut:
        yield escaped(translate(_joined(lines[:cut]))) + "\n"
    rest = next((k for k in range(cut, len(lines)) if not lines[k].startswith(" ")), len(lines))
    if cut < rest:
        yield "```text\n" + dedent("\n".join(lines[cut:rest])) + "\n```\n"
    if rest < len(lines):
        yield from _mixed_lines(lines[rest:], translate)


def _joined(lines: list[str]) -> str:
    return " ".join(line.strip() for line in lines if line.strip())


def escaped(text: str) -> str:
    """Return the text with the special characters of Markdown escaped, except in backticks; a page becomes a link."""
    parts = re.split(r"(`[^`\n]*`|docs/[\w/-]+\.md)", text)
    out = "".join(
        SPECIAL.sub(r"\\\1", part) if k % 2 == 0 else part if part[0] == "`" else f"[{part}](../{part[5:]})"
        for k, part in enumerate(parts)
    )
    return re.sub(r"^(\s*)([-+]|\d+\.)(\s)", r"\1\\\2\3", out, flags=re.MULTILINE)
