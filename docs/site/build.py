"""Build the site: collect the pages of each language, and convert them with Sphinx, without a network."""

import os
import re
import shutil
import tempfile
from itertools import cycle
from pathlib import Path
from typing import Any

from docs.site.pages import ROOT, Edition
from docs.site.reference import COMMON, reference

HERE = Path(__file__).parent
MAX_NARROW_LETTERS = 40  # of a cell for which a phone has room beside two others
NAMES = {"en": "English", "es": "Español"}
THEME_TEXTS = {  # texts of the theme, which exists only in English
    "es": {
        "Auto light/dark, in dark mode": "Automático, ahora oscuro",
        "Auto light/dark, in light mode": "Automático, ahora claro",
        "Back to top": "Volver arriba",
        "Contents": "Contenido",
        "Dark mode": "Modo oscuro",
        "Expand": "Desplegar",
        "Home": "Inicio",
        "Light mode": "Modo claro",
        "Link to this heading": "Enlace a este título",
        "Made with": "Hecho con",
        "Menu": "Menú",
        "Next": "Siguiente",
        "On this page": "En esta página",
        "Previous": "Anterior",
        "Skip to content": "Ir al contenido",
        "Toggle Light / Dark / Auto color theme": "Cambiar el tema: claro, oscuro o automático",
        "Toggle navigation of ": "Mostrar u ocultar las páginas de ",  # the title of a page follows
        "Toggle site navigation sidebar": "Mostrar u ocultar el índice del sitio",
        "Toggle table of contents sidebar": "Mostrar u ocultar el contenido de la página",
    }
}


def build(out: Path) -> bool:
    """Write the site into `out` and return True; after a warning keep the old site and return False."""
    out = out.resolve()
    with tempfile.TemporaryDirectory(prefix="baqueano-site-") as folder:
        build_folder = Path(folder)
        Edition("en").write(build_folder / "en", reference())
        Edition("es").write(build_folder / "es", reference("es"))
        fine = all(
            [
                _sphinx(build_folder / "en", build_folder / "site", "en"),
                _sphinx(build_folder / "es", build_folder / "site" / "es", "es"),
            ]
        )
        for page in (build_folder / "site" / "es").rglob("*.html"):
            page.write_text(theme_in(page.read_text(encoding="utf-8"), "es"), encoding="utf-8")
        if fine:
            shutil.rmtree(out, ignore_errors=True)
            shutil.copytree(
                build_folder / "site", out, ignore=shutil.ignore_patterns(".buildinfo", "objects.inv")
            )
    return fine


def _sphinx(source: Path, out: Path, language: str) -> bool:
    """Convert the pages of a language; return False after a warning of Sphinx."""
    from sphinx.application import Sphinx
    from sphinx.util.console import nocolor
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    nocolor()
    os.environ.setdefault("SOURCE_DATE_EPOCH", "0")  # the same pages give the same files
    with patch_docutils(str(source)), docutils_namespace():
        app = Sphinx(
            source, None, out, source.with_name(f"{language}-trees"), "html", settings(language),
            status=None, freshenv=True, parallel=1,
        )  # fmt: skip
        app.connect("html-page-context", _complete_body)
        app.build(force_all=True)
    return app.statuscode == 0 and not app._warncount


def theme_in(page: str, language: str) -> str:
    """Return the HTML of a page with the texts of the theme in another language.

    >>> theme_in("<span>Next</span>", "es")
    '<span>Siguiente</span>'
    """
    texts = THEME_TEXTS[language]
    english = "|".join(map(re.escape, sorted(texts, key=len, reverse=True)))
    return re.sub(
        rf'(?<=[>"])(\s*)({english})(?:(?=\s*[<"])|(?<= ))', lambda match: match[1] + texts[match[2]], page
    )


def settings(language: str) -> dict[str, Any]:
    """Return Sphinx's configuration."""
    return {
        "project": "baqueano",
        "author": "The baqueano developers",
        "language": language,
        "extensions": ["myst_parser", "docs.site.mathematics"],
        "myst_enable_extensions": ["dollarmath", "deflist"],
        "myst_heading_anchors": 5,
        "myst_url_schemes": {
            "http": None, "https": None, "mailto": None, "en": "../{{path}}#{{fragment}}",
        },
        "myst_dmath_double_inline": True,
        "html_math_renderer": "mathml",
        "highlight_language": "none",
        "smartquotes": False,  # a quoted text of the reference is a value to copy
        "html_theme": "furo",
        "html_title": "baqueano",
        "html_static_path": [str(HERE / "static")],
        "html_css_files": ["site.css"],
        "html_copy_source": False,
        "html_show_sourcelink": False,
        "html_show_sphinx": False,
        "html_show_copyright": False,
        "html_search_language": language,
        "html_search_scorer": str(HERE / "search_order.js"),
        "html_show_search_summary": False,  # a page that is opened as a file cannot read other files
        "html_theme_options": {"light_css_variables": {"color-brand-primary": "#1f5f8b",
                                                       "color-brand-content": "#1f5f8b"},
                               "dark_css_variables": {"color-brand-primary": "#7db8e0",
                                                      "color-brand-content": "#7db8e0"}},
        "python_maximum_signature_line_length": 88,
        "suppress_warnings": [],
    }  # fmt: skip


def _complete_body(app: Any, page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    """Add a link to the other language above each page, and headings for a phone. The link leads to the same page, or
    to the first page if it is missing.
    """
    language = app.config.language
    second = "es" if language == "en" else "en"
    target_page = page if page in {*Edition(second).sources, *COMMON, "search", "genindex"} else "index"
    up = "../" * page.count("/")
    target = f"{up}es/{target_page}.html" if second == "es" else f"../{up}{target_page}.html"
    switch = (
        f'<p class="languages"><span lang="{language}">{NAMES[language]}</span> · '
        f'<a href="{target}" lang="{second}" hreflang="{second}">{NAMES[second]}</a></p>'
    )
    context["body"] = switch + with_headings_in_cells(context.get("body", ""))


def with_headings_in_cells(page: str) -> str:
    """Return HTML in which the cells of each table of sentences name their column, for a phone without room for it.

    >>> with_headings_in_cells("<table><th>a</th><th>b</th><th>c</th><td>short</td></table>")
    '<table><th>a</th><th>b</th><th>c</th><td>short</td></table>'
    """

    def table(match: re.Match[str]) -> str:
        headings = [_plain(head) for head in re.findall(r"<th\b[^>]*>(.*?)</th>", match[0], re.DOTALL)]
        cells = re.findall(r"<td\b[^>]*>(.*?)</td>", match[0], re.DOTALL)
        if len(headings) < 3 or max(map(len, map(_plain, cells)), default=0) <= MAX_NARROW_LETTERS:
            return match[0]
        columns = cycle(headings)

        def cell(match: re.Match[str]) -> str:
            heading = next(columns)
            content = match[1]
            return f'<td data-heading="{heading}">{content}' if _plain(content) else '<td class="empty">'

        text = re.sub(r"<td\b[^>]*>(.*?)(?=</td>)", cell, match[0], flags=re.DOTALL)
        return text.replace('<table class="', '<table class="cards ', 1)

    return re.sub(r"<table\b.*?</table>", table, page, flags=re.DOTALL)


def _plain(text: str) -> str:
    """Return HTML without its tags."""
    return re.sub(r"<[^>]*>", "", text).strip()


__all__ = ["ROOT", "build", "settings"]
