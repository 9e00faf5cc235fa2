"""Every screen in four sizes, two themes and two languages: no text is cut, hidden, faint or without a name."""

import json
import os
from itertools import product

import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.screens import (
    AXE,
    BOXES,
    LANGUAGES,
    SCREEN_KINDS,
    THEMES,
    axe,
    each_screen,
    looked_at,
    open_page,
    shot,
)

# sizes and themes of each language; every pair of size and theme, and of size and language, and all in `make test-all`
LOOKS = {
    "en": [("phone", "light"), ("tablet", "dark"), ("laptop", "dark"), ("projector", "light")],
    "es": [("phone", "dark"), ("tablet", "light"), ("laptop", "light"), ("projector", "dark")],
}
LOOKS_OF_AXE = {  # which judges names and contrast: each size, each theme, each language
    "en": [("phone", "light"), ("laptop", "dark")],
    "es": [("laptop", "light"), ("projector", "dark")],
}
if os.environ.get("BAQUEANO_LONG"):
    LOOKS = LOOKS_OF_AXE = {language: list(product(SIZES, THEMES)) for language in LANGUAGES}

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
HAS_AXE = AXE.is_file() or bool(os.environ.get("CI"))


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("kind", SCREEN_KINDS)
def test_no_screen_has_a_layout_fault_or_an_accessibility_violation(browser, kind, language):
    """No text is cut, overlaps another text, is faint, or extends beyond the edge; axe-core reports nothing."""
    faults, passes = {}, []
    for screen, tab in each_screen(browser, kind, language):
        for look in LOOKS[language]:
            looked_at(tab, *look)
            shot(tab, kind, screen, *look, language)
            violations = axe(tab) if HAS_AXE and look in LOOKS_OF_AXE[language] else {}
            passes += [violations["passes"]] if violations else []
            if problems := [*tab.js(BOXES), *violations.get("violations", ())]:
                faults[f"{screen} {look}"] = problems
        looked_at(tab, "laptop", "light")
    assert not faults, json.dumps(faults, indent=1, ensure_ascii=False)
    if not HAS_AXE:
        pytest.skip("axe-core is not installed: make browser-tools")
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
    small = tab.js("""[...document.querySelectorAll("#lease, #settings button, .map-buttons button")].filter((one) => {
      const { left, right, top, bottom } = one.getBoundingClientRect(), middle = (top + bottom) / 2;
      return [-21, 21].some((far) => document.elementFromPoint((left + right) / 2, middle + far) !== one);
    }).map((one) => one.id || one.title)""")
    assert small == []
