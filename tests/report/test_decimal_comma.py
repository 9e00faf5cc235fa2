"""In Spanish the numbers of a report, its figures included, have a decimal comma."""

import html
import re

from baqueano.messages.language import use_language
from baqueano.report.libraries import panel
from baqueano.report.run_report import run_page
from tests.report.test_page import a_run

POINT = re.compile(r"(?<![\w./#=-])\d+\.\d+(?![\w./])")
NOT_SHOWN = re.compile(
    r"<style.*?</style>|<code>.*?</code>|<metadata>.*?</metadata>|<defs>.*?</defs>", re.DOTALL
)


def shown_text(page: str) -> str:
    """Return the text between the tags of a page, also in its drawings."""
    return html.unescape("\n".join(re.findall(r">([^<>]+)<", NOT_SHOWN.sub("", page))))


def test_the_numbers_of_a_spanish_report_have_a_decimal_comma():
    with use_language("es"):
        text = shown_text(run_page(a_run()).html())
    assert POINT.findall(text) == []
    assert len(re.findall(r"\d,\d", text)) > 20


def test_the_axes_of_a_spanish_figure_have_a_decimal_comma():
    with use_language("es"):
        figure, axes = panel((4.0, 3.0))
        axes.plot([0.0, 1.0], [0.0, 1e-7])
        figure.canvas.draw()
    labels = [label.get_text() for axis in (axes.xaxis, axes.yaxis) for label in axis.get_ticklabels()]
    assert "0,4" in labels
    assert not [label for label in labels if "." in label]
