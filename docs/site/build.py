"""Build the site: collect the pages of each language, and convert them with Sphinx, without a network."""

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

from docs.site.pages import ROOT, Edition

HERE = Path(__file__).parent
NAMES = {"en": "English", "es": "Español"}


def build(out: Path) -> bool:
    """Write the site into `out` and return True; after a warning keep the old site and return False."""
    from docs.site.reference import reference

    out = out.resolve()
    with tempfile.TemporaryDirectory(prefix="baqueano-site-") as folder:
        build_folder = Path(folder)
        Edition("en").write(build_folder / "en", reference())
        Edition("es").write(build_folder / "es")
        fine = all(
            [
                _sphinx(build_folder / "en", build_folder / "site", "en"),
                _sphinx(build_folder / "es", build_folder / "site" / "es", "es"),
            ]
        )
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
        app.connect("html-page-context", _languages)
        app.build(force_all=True)
    return app.statuscode == 0 and not app._warncount


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
        "html_theme": "furo",
        "html_title": "baqueano",
        "html_static_path": [str(HERE / "static")],
        "html_css_files": ["site.css"],
        "html_copy_source": False,
        "html_show_sourcelink": False,
        "html_show_sphinx": False,
        "html_show_copyright": False,
        "html_search_language": language,
        "html_show_search_summary": False,  # a page that is opened as a file cannot read other files
        "html_theme_options": {"light_css_variables": {"color-brand-primary": "#1f5f8b",
                                                       "color-brand-content": "#1f5f8b"},
                               "dark_css_variables": {"color-brand-primary": "#7db8e0",
                                                      "color-brand-content": "#7db8e0"}},
        "python_maximum_signature_line_length": 88,
        "suppress_warnings": [],
    }  # fmt: skip


def _languages(app: Any, page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    """Add a link to the other language above each page: to the same page, or to the first page if it is missing."""
    language = app.config.language
    second = "es" if language == "en" else "en"
    target_page = page if page in {*Edition(second).sources, "search", "genindex"} else "index"
    up = "../" * page.count("/")
    target = f"{up}es/{target_page}.html" if second == "es" else f"../{up}{target_page}.html"
    switch = (
        f'<p class="languages"><span lang="{language}">{NAMES[language]}</span> · '
        f'<a href="{target}" lang="{second}" hreflang="{second}">{NAMES[second]}</a></p>'
    )
    context["body"] = switch + context.get("body", "")


__all__ = ["ROOT", "build", "settings"]
