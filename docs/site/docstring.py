"""Convert a docstring to Markdown: paragraphs, sections of numpydoc, examples, and indented equations."""

import re
from collections.abc import Iterator
from textwrap import dedent

SPECIAL = re.compile(r"([\\*_<>\[\]$|#~^{}])")
SET_IN = "    "
RULE = re.compile(r"-{3,}\s*$")
LISTED = ("Parameters", "Returns", "Raises", "Attributes", "Yields", "Methods", "Other Parameters")


def markdown(docstring: str) -> str:
    """Return the Markdown of a docstring whose indentation is clean (inspect.getdoc)."""
    out = []
    for heading, lines in _sections(docstring.splitlines()):
        if heading:
            out.append(f"**{heading}**\n")
        out += list(_entries(lines) if heading in LISTED else _blocks(lines))
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


def _entries(lines: list[str]) -> Iterator[str]:
    """Yield a list of the entries of a section: `name : type`, and an indented description."""
    name, content = "", list[str]()

    def entry() -> Iterator[str]:
        if name:
            words, _, kind = name.partition(" : ")
            head = f"`{words.strip()}`" + (f", {escaped(kind.strip())}" if kind else "")
            text = escaped(" ".join(line.strip() for line in content if line.strip()))
            yield f"- {head}" + (f": {text}" if text else "")

    for line in lines:
        if line.strip() and line[0] != " ":
            yield from entry()
            name, content = line, []
        else:
            content.append(line)
    yield from entry()
    yield ""


def _blocks(lines: list[str]) -> Iterator[str]:
    """Yield paragraphs, examples, and indented blocks without changes."""
    for part in _paragraphs(lines):
        if part.lstrip().startswith(">>>"):
            yield f"```pycon\n{dedent(part)}\n```\n"
        elif part.startswith(SET_IN):
            yield f"```text\n{dedent(part)}\n```\n"
        elif part.startswith(("- ", "* ")):
            yield "\n".join(_item(line) for line in part.splitlines()) + "\n"
        else:
            yield from _mixed_lines(part.splitlines())


def _paragraphs(lines: list[str]) -> list[str]:
    """Return the paragraphs, which empty lines separate; successive indented paragraphs are joined."""
    parts = list[str]()
    for part in re.split(r"\n\s*\n", "\n".join(lines).strip("\n")):
        if parts and part.startswith(SET_IN) and parts[-1].startswith(SET_IN):
            parts[-1] += f"\n\n{part}"
        elif part.strip():
            parts.append(part)
    return parts


def _item(line: str) -> str:
    """Return a line of a list."""
    mark = re.match(r"\s*[-*] |", line)
    assert mark is not None
    return mark.group() + escaped(line[mark.end() :])


def _mixed_lines(lines: list[str]) -> Iterator[str]:
    """Yield a paragraph whose last lines may be indented: an equation after its sentence."""
    cut = next((k for k, line in enumerate(lines) if line.startswith(SET_IN)), len(lines))
    if cut:
        yield escaped("\n".join(lines[:cut])) + "\n"
    rest = next((k for k in range(cut, len(lines)) if not lines[k].startswith(" ")), len(lines))
    if cut < rest:
        yield "```text\n" + dedent("\n".join(lines[cut:rest])) + "\n```\n"
    if rest < len(lines):
        yield from _mixed_lines(lines[rest:])


def escaped(text: str) -> str:
    """Return the text with the special characters of Markdown escaped, except inside backticks."""
    parts = re.split(r"(`[^`\n]*`)", text)
    out = "".join(part if k % 2 else SPECIAL.sub(r"\\\1", part) for k, part in enumerate(parts))
    return re.sub(r"^(\s*)([-+]|\d+\.)(\s)", r"\1\\\2\3", out, flags=re.MULTILINE)
