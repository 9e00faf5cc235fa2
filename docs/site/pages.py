"""Collect the pages of the site from the files of this repository, in a folder for each language.

The files are plain Markdown with links from file to file. A link to a page of the site becomes a link inside the site.
If a link leads to another file, this file is copied into the site.
"""

import re
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
FENCE = re.compile(r"^(```.*?^```|~~~.*?^~~~)$", re.MULTILINE | re.DOTALL)
ELSEWHERE = {  # page of the site → file outside docs/
    "changelog": ROOT / "CHANGELOG.md",
    "contributing": ROOT / "CONTRIBUTING.md",
    "firmware": ROOT / "firmware" / "uno" / "README.md",
}
ORDER = {  # heading of the menu → its pages; the second also lists each page of docs/ that is not named here
    "Begin": ("first-evening", "course", "architecture", "python"),
    "How to": (
        "identification", "controllers", "routes", "estimators", "sweep", "importing", "own-vehicle", "driving",
        "vehicle-file"),
    "The vehicle": ("build", "robot", "firmware"),
    "Derivations": (),
    "Reference": ("reference/index", "glossary", "benchmarks", "errata", "changelog", "contributing"),
}  # fmt: skip
SPANISH = {
    "Begin": "Para empezar",
    "How to": "Cómo se hace",
    "The vehicle": "El vehículo",
    "Derivations": "Deducciones",
    "Reference": "Referencia",
}


@dataclass(frozen=True)
class Edition:
    """The site in one language: "en", or "es" for the pages of docs/es."""

    language: str

    @cached_property
    def sources(self) -> dict[str, Path]:
        """Return the file of each page of this language, by the name of the page."""
        folder = DOCS / "es" if self.language == "es" else DOCS
        own = [*sorted(folder.glob("*.md")), *sorted((folder / "derivations").glob("*.md"))]
        pages = {_name(path.relative_to(folder).with_suffix("").as_posix()): path for path in own}
        return pages if self.language == "es" else pages | ELSEWHERE

    def menu(self, extra_pages: tuple[str, ...] = ()) -> dict[str, list[str]]:
        """Return the pages below each heading; `extra_pages` are names of generated pages."""
        have = {*self.sources, *extra_pages} - {"index"}
        page_names = {name for names in ORDER.values() for name in names}
        out = {}
        for heading, names in ORDER.items():
            pages = [name for name in names if name in have]
            if heading == "How to":
                pages += sorted(name for name in have - page_names if "/" not in name)
            if heading == "Derivations":
                pages += sorted(name for name in have if name.startswith("derivations/"))
            title = SPANISH[heading] if self.language == "es" else heading
            if pages:
                out[title] = pages
        return out

    def write(self, folder: Path, extra_pages: dict[str, str] | None = None) -> None:
        """Write all pages and the files that they link to into `folder`; `extra_pages` are generated pages, by name."""
        extra_pages = extra_pages or {}
        for name, path in self.sources.items():
            text = self._linked(path, folder)
            if name == "index":
                text += _toctrees(self.menu(tuple(extra_pages)))
            _write_page(folder / f"{name}.md", text)
        for name, text in extra_pages.items():
            _write_page(folder / f"{name}.md", text)

    def _linked(self, path: Path, folder: Path) -> str:
        """Return the text of a page with the links of the site; code is not changed."""
        text = re.sub(r"^```math$", "```{math}", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        parts = FENCE.split(text)
        return "".join(
            part if FENCE.fullmatch(part) else LINK.sub(lambda m: self._link(m, path, folder), part)
            for part in parts
        )

    def _link(self, match: re.Match[str], path: Path, folder: Path) -> str:
        """Return a link in the form of the site."""
        image, label, target = match.groups()
        if re.match(r"[a-z]+:|#", target):
            return match.group()
        file, _, anchor = target.partition("#")
        target_file = (path.parent / file).resolve()
        own_name = next(name for name, source in self.sources.items() if source == path)
        up = "../" * own_name.count("/")
        anchor = f"#{anchor}" if anchor else ""
        if page := self._page(target_file):
            return f"[{label}]({up}{page}.md{anchor})"
        if self.language == "es" and (page := Edition("en")._page(target_file)):
            return f"[{label}](en:{up}{page}.html{anchor})"
        if target_file.is_dir():
            return label
        if not target_file.is_file():
            return match.group()  # Sphinx reports it
        copy = target_file.relative_to(ROOT).as_posix()
        (folder / "files" / copy).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(target_file, folder / "files" / copy)
        return f"{image}[{label}]({up}files/{copy})"

    def _page(self, file: Path) -> str | None:
        return next((name for name, source in self.sources.items() if source == file), None)


def _name(stem: str) -> str:
    """Return the name of the page of a file; README becomes the index of its folder."""
    return "index" if stem == "README" else stem


def _write_page(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")


def _toctrees(menu: dict[str, list[str]]) -> str:
    trees = [
        f"\n```{{toctree}}\n:hidden:\n:caption: {heading}\n\n" + "\n".join(pages) + "\n```\n"
        for heading, pages in menu.items()
    ]
    return "\n" + "".join(trees)
