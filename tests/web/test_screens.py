"""Every screen in three sizes, two themes and two languages: no text is cut, hidden, faint or without a name."""

import json
import os
from itertools import product

import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.screens import (
    AXE,
    BOXES,
    LANGUAGES,
    SEEN,
    THEMES,
    axe,
    each_screen,
    looked_at,
    open_page,
    shot,
)

# sizes and themes of each language; every pair of size and theme, and of size and language, and all in `make test-all`
LOOKS = {
    "en": [("phone", "light"), ("laptop", "dark"), ("projector", "light")],
    "es": [("phone", "dark"), ("laptop", "light"), ("projector", "dark")],
}
AXE_LOOKS = {  # likewise
    "en": [("laptop", "light"), ("laptop", "dark")],
    "es": [("phone", "light"), ("projector", "dark")],
}
if os.environ.get("BAQUEANO_LONG"):
    LOOKS = AXE_LOOKS = {language: list(product(SIZES, THEMES)) for language in LANGUAGES}

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
needs_axe = pytest.mark.skipif(
    not AXE.is_file() and not os.environ.get("CI"), reason="axe-core is not installed: make browser-tools"
)


@pytest.mark.parametrize(("language", "looks"), LOOKS.items())
@pytest.mark.parametrize("kind", SEEN)
def test_no_screen_has_a_layout_fault(browser, kind, language, looks):
    """No text is cut, overlaps another text, is faint, or extends beyond the edge."""
    faults = {}
    for screen, tab in each_screen(browser, kind, language):
        for look in looks:
            looked_at(tab, *look)
            shot(tab, kind, screen, *look, language)
            if problems := tab.js(BOXES):
                faults[f"{screen} {look}"] = problems
        looked_at(tab, "laptop", "light")
    assert not faults, json.dumps(faults, indent=1, ensure_ascii=False)


@needs_axe
@pytest.mark.parametrize(("language", "looks"), AXE_LOOKS.items())
@pytest.mark.parametrize("kind", SEEN)
def test_axe_reports_no_accessibility_violation_on_any_screen(browser, kind, language, looks):
    faults, passes = {}, []
    for screen, tab in each_screen(browser, kind, language):
        for look in looks:
            looked_at(tab, *look)
            judged = axe(tab)
            passes.append(judged["passes"])
            if judged["violations"]:
                faults[f"{screen} {look}"] = judged["violations"]
    assert not faults, json.dumps(faults, indent=1, ensure_ascii=False)
    assert min(passes) > 15  # rules that had something to judge


@pytest.mark.parametrize(
    ("spoil", "finds"),
    [
        ("p.style.top = '70px'; p.style.left = '60px'", "overlap"),
        ("p.style.top = '300px'; p.style.left = `${innerWidth - 20}px`", "beyond the edge"),
        ("p.style.top = '-200px'; p.style.color = '#eee'", "faint"),
        ("p.replaceWith(document.createElement('input'))", "nameless"),
        ("p.style.top = '300px'; p.style.width = '60px'; p.style.overflow = 'hidden'", "cut"),
        ("p.className = 'chip'; p.style.top = '300px'; p.style.width = '60px'", "wider than its box"),
        (
            "document.getElementById('keys').show(); document.getElementById('close').before(p);"
            "p.style.position = 'static'; p.style.margin = '0 0 -30px'",
            "overlap",
        ),
    ],
)
def test_the_layout_check_detects_each_fault(tab, live, spoil, finds):
    open_page(tab, live, screen="runs")
    tab.js(
        "(() => { const p = document.createElement('p'); p.textContent = 'a text that stands in the way of another';"
        f"p.style.position = 'fixed'; p.style.whiteSpace = 'nowrap'; document.body.append(p); {spoil}; }})()"
    )
    problems = tab.js(BOXES)
    assert any(problem.startswith(finds) for problem in problems), problems


def test_on_a_phone_each_small_button_answers_a_finger_of_44_px(tab, live):
    tab.size(*SIZES["phone"])
    open_page(tab, live, screen="drive")
    missed = tab.js("""[...document.querySelectorAll("#lease, #settings button, .map-buttons button")].filter((one) => {
      const { left, right, top, bottom } = one.getBoundingClientRect(), middle = (top + bottom) / 2;
      return [-21, 21].some((far) => document.elementFromPoint((left + right) / 2, middle + far) !== one);
    }).map((one) => one.id || one.title)""")
    assert missed == []
