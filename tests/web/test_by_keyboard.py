"""Every screen with the keyboard only: all elements are reachable, the focus is visible, and reduced motion is
respected.
"""

import time

import pytest

from tests.web.chromium import CHROMIUM
from tests.web.screens import DRAWN, LIVE, PAGE, SCREENS, open_page

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")

WATCH = """addEventListener("focusin", ({ target }) => {
  seen.reached.add(target);
  if (getComputedStyle(target).outlineStyle === "none") seen.unseen.push(target.outerHTML.slice(0, 120));
})"""
CONTROLS = """[...document.querySelectorAll("button, a, select, input, [tabindex='0']")]
  .filter((node) => node.checkVisibility() && !node.disabled && node.tabIndex >= 0)"""


def walked(tab, screen: str) -> dict[str, list[str]]:
    """Move through a screen by Tab from its top; return the unreached elements and those without visible focus."""
    tab.js("globalThis.seen = { reached: new Set(), unseen: [] }; document.activeElement.blur()")
    for _ in range(tab.js(f"{CONTROLS}.length") + 4):
        tab.press("Tab", "Tab")
    unreached_nodes = (
        f"{CONTROLS}.filter((node) => !seen.reached.has(node)).map((node) => node.outerHTML.slice(0, 120))"
    )
    return {"not reached": tab.js(unreached_nodes), "no focus seen": tab.js("seen.unseen")}


def by_keys(tab, screens: tuple[str, ...]) -> dict[str, dict[str, list[str]]]:
    """Open each screen by its number and move through it; return all faults."""
    tab.js("globalThis.seen = { reached: new Set(), unseen: [] }")
    tab.js(WATCH)
    faults = {}
    for k, screen in enumerate(screens, 1):
        tab.js("document.activeElement.blur()")
        tab.press(str(k), f"Digit{k}", str(k))
        tab.wait(f"document.body.dataset.screen === {screen!r}")
        if screen == "tune":
            tab.wait(f"Boolean({PAGE}.screens.tune.lap)")
        if any((problems := walked(tab, screen)).values()):
            faults[screen] = problems
    return faults


def test_every_element_of_a_drive_is_reachable_by_tab_with_visible_focus(driver):
    assert not by_keys(driver, LIVE)


def test_every_element_of_a_run_is_reachable_by_tab_with_visible_focus(tab, replay):
    open_page(tab, replay)
    assert not by_keys(tab, SCREENS)


def test_with_reduced_motion_the_map_is_not_animated(tab, live):
    tab.media(prefers_reduced_motion="reduce")
    open_page(tab, live)
    tab.js(f"{PAGE}.screen.map.zoom(3)")
    tab.press("0", "Digit0", "0")
    tab.js(DRAWN)
    first = tab.js(f"{PAGE}.screen.map.view.scale")
    time.sleep(0.4)
    assert tab.js(f"{PAGE}.screen.map.view.scale") == pytest.approx(first, rel=0.02)


@pytest.mark.parametrize("motion", ["reduce", "no-preference"])
def test_a_tuning_lap_is_not_animated_with_reduced_motion(tab, live, motion):
    tab.media(prefers_reduced_motion=motion)
    open_page(tab, live, screen="tune")
    tab.wait(f"Boolean({PAGE}.screens.tune.lap)")
    places = tab.js(
        f"(() => {{ const {{ tune }} = {PAGE}.screens, places = [], draw = tune.map.draw.bind(tune.map);"
        "tune.map.draw = (scene) => { places.push(scene.vehicles[0].pose.join()); draw(scene); };"
        "const began = performance.now(); for (const later of [0, 700, 1900]) tune.draw(began + later);"
        "tune.map.draw = draw; return new Set(places).size; })()"
    )
    assert places == (1 if motion == "reduce" else 3)
    tab.js(f"{PAGE}.screens.tune.downhill()")
    path = f"JSON.stringify({PAGE}.screens.tune.path?.path)"
    tab.wait(f"Boolean({PAGE}.screens.tune.path)")
    if motion == "reduce":  # at the end of the path at once
        assert tab.js(
            f"JSON.stringify([{PAGE}.screens.tune.values]) === JSON.stringify(JSON.parse({path}).slice(-1))"
        )
