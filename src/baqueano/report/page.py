"""Write one self-contained HTML page to read or print: headline figures, tables, drawings; without script or
network."""

import html
import io
import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from baqueano.atomic_file import replace_file
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict, nearest, note
from baqueano.errors import UsageError
from baqueano.messages import text, unbroken
from baqueano.messages.language import current_language, number, translate as _

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TONES = {
    Verdict.USABLE: "good", "OK": "good", Verdict.WARN: "warn", Verdict.REFUSED: "bad", Verdict.STOPPED: "bad",
    Verdict.CONSISTENT: "good", Verdict.INCONSISTENT: "warn", "LOCALIZED": "good", "LOST": "bad",
}  # fmt: skip
WIDE_IN, NARROW_IN, MIN_IN = 8.0, 4.4, 2.4  # of figures: over time; on a phone
UNTRANSLATED_COLUMNS = {
    "name",
    "parameter",
    "run",
    "command",
    "number",
    "gain",
    "unit",
}  # columns of identifiers
FORMATS, DPI = ("svg", "pdf", "png"), 300  # of figures as files; dots per inch of a png


@dataclass(frozen=True)
class Headline:
    """A figure at the top of a page, with its label and a note."""

    label: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of a result in their printed form. `rows` are flat dicts with the same keys."""

    rows: list[TableRow]
    caption: str = ""
    columns: dict[str, str] | None = None  # key → heading; None: the keys of the first row

    @property
    def headings(self) -> dict[str, str]:
        """Return the heading of each column by its key, except of columns without a value."""
        columns = self.columns or {
            key: _(key.replace("_", " ")) for key in (self.rows[0] if self.rows else {})
        }
        return {
            key: columns[key] for key in columns if any(row.get(key) not in (None, "") for row in self.rows)
        }


@dataclass(frozen=True)
class Drawing:
    """A figure with a caption that explains it."""

    figure: "Figure"
    caption: str

    @cached_property
    def svg(self) -> str:
        """Return the figure as SVG text in full width and, if it is wide, again in the width of a phone."""
        from baqueano.report.canvas import with_narrow_legends

        svg = _svg(self.figure, "wide", self.caption)
        wide_in, high_in = self.figure.get_size_inches()
        if wide_in > NARROW_IN:
            scale = 1.0 if wide_in > WIDE_IN else NARROW_IN / wide_in  # panels over time keep their height
            self.figure.set_size_inches(NARROW_IN, max(high_in * scale, MIN_IN))
            with with_narrow_legends(self.figure):
                svg += _svg(self.figure, "narrow", self.caption)
            self.figure.set_size_inches(wide_in, high_in)
        return svg


@dataclass(frozen=True)
class Section:
    """A heading, a list of sentences, paragraphs, and tables and drawings in their order."""

    title: str
    text: str = ""
    parts: list[Table | Drawing] = field(default_factory=list)
    items: list[str] = field(default_factory=list)  # before the text


@dataclass(frozen=True, repr=False)
class Page:
    """A complete report.

    Attributes
    ----------
    title, subtitle : str
        Heading and subheading.
    verdict : str
        The word in the badge; "" without a badge.
    headlines : list of Headline
        The figures at the top.
    sections : list of Section
        Heading, text, tables and drawings.
    reproduce : str
        The command that reproduces these numbers.

    Examples
    --------
    >>> Page("Nothing", "an empty page", "", [], [])
    Page('Nothing', 0 sections, 0 figures)
    """

    title: str
    subtitle: str
    verdict: str
    headlines: list[Headline]
    sections: list[Section]
    reproduce: str = ""

    def html(self) -> str:
        """Return the whole page as text. Raise UsageError if jinja2 is not installed."""
        from importlib.resources import files

        from baqueano.report.libraries import jinja2

        environment = jinja2().Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
        environment.filters |= {"cell": cell, "word": _, "unbroken": unbroken}
        template = files("baqueano.report").joinpath("page.html.jinja").read_text(encoding="utf-8")
        tone = TONES.get(self.verdict, "plain")
        return environment.from_string(template).render(page=self, tone=tone, language=current_language())

    @property
    def footer(self) -> str:
        """Return the last line of the page."""
        return _("Written by baqueano. SI units; angles in degrees if stated.")

    @property
    def reproduce_sentence(self) -> str:
        """Return the sentence before the command `reproduce`."""
        return _("To reproduce these numbers:")

    def __repr__(self) -> str:
        count = len(self.drawings())
        return text(note("front.page", title=self.title, sections=len(self.sections), drawings=count))

    def _repr_html_(self) -> str:
        """Return the page in a frame as HTML, for a notebook."""
        document = html.escape(self.html(), quote=True)
        return f'<iframe srcdoc="{document}" style="width: 100%; height: 640px; border: 1px solid #8884"></iframe>'

    def drawings(self) -> dict[str, Drawing]:
        """Return the figures in their order, with names that are valid file names, such as "01-path"."""
        all_drawings = [
            (section.title, part)
            for section in self.sections
            for part in section.parts
            if isinstance(part, Drawing)
        ]
        names = [re.sub(r"\W+", "-", title.lower()).strip("-") for title, _drawing in all_drawings]
        return {
            f"{k + 1:02d}-{name}": drawing
            for k, (name, (_title, drawing)) in enumerate(zip(names, all_drawings, strict=True))
        }

    def save_figures(
        self, folder: str | Path, file_format: str = "svg", width: str | float | None = None
    ) -> list[Path]:
        """Write each figure as "01-path.svg" into `folder`, and return the files.

        `file_format` is svg, pdf or png, `width` "column", "page" or millimetres. Raise UsageError for other values.
        """
        check_format(file_format, width)
        from baqueano.report.canvas import with_width

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        paths = []
        for name, drawing in self.drawings().items():
            paths.append(folder / f"{name}.{file_format}")
            with with_width(drawing.figure, width) as figure:
                figure.savefig(paths[-1], dpi=DPI)
        return paths

    def save(self, path: str | Path) -> Path:
        """Write the page, and return its path.

        The file is replaced at once, so that a reader never receives an incomplete page. Raise UsageError for the name
        of a figure, such as "fit.pdf".
        """
        suffix = Path(path).suffix.lower().removeprefix(".")
        if suffix in FORMATS:
            fix = f'page.save_figures("figures", "{suffix}")'
            raise UsageError.of("front.page-as-figure", fix, value=str(path))
        return save_text(path, self.html())


def check_format(file_format: str, width: str | float | None = None) -> None:
    """Raise UsageError for figures that cannot be written in this format, or at this width."""
    if file_format not in FORMATS:
        raise UsageError.of(
            "front.format-unknown", value=file_format, suggestion=nearest(file_format, FORMATS)
        )
    if width is not None:
        from baqueano.report.libraries import matplotlib

        matplotlib()
        from baqueano.report.canvas import width_mm

        width_mm(width)


def save_text(path: str | Path, text: str) -> Path:
    """Write a file that appears complete or not at all, and return its path. It replaces an older file of this name."""
    return replace_file(Path(path), text)


def cell(value: object, key: str = "") -> str:
    """Return the text of a cell in column `key`: a float with four significant digits, a dash for an unknown value.

    Words are in the current language, except in the columns UNTRANSLATED_COLUMNS.
    """
    if value is None or value != value:
        return "–"
    if isinstance(value, bool):
        return _("yes") if value else _("no")
    if isinstance(value, float):
        return f"{number(value):.4g}"
    return str(value) if key in UNTRANSLATED_COLUMNS else _(str(value))


def draw(figure: "Figure", caption: str) -> Drawing:
    """Return the figure as a part of a page."""
    return Drawing(figure, caption)


def _svg(figure: "Figure", shape: str, caption: str) -> str:
    """Return one <svg> whose ids differ between the wide and the narrow shape.

    So the page can hide one shape, and the other one stays intact.
    """
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": f"baqueano {shape}"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    attributes = f'class="{shape}" role="img" aria-label="{html.escape(caption)}"'
    return svg[svg.index("<svg") :].replace("<svg", f"<svg {attributes}", 1)
