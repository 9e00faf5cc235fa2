"""The screens that use a worker, in a real browser with a script: gains, blocks, comparisons."""

import pytest

from tests.web.chromium import CHROMIUM
from tests.web.screens import PAGE, open_page, until
from tests.web.scripted import ScriptedServer

TUNE = f"{PAGE}.screens.tune"

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")


def tune_page(tab, live):
    open_page(tab, live, screen="tune")
    tab.press("l", "KeyL", "l")
    tab.wait(f"{PAGE}.hand.mine && Boolean({TUNE}.lap)")


def test_each_slider_move_simulates_a_lap_and_a_descent_is_shown(tab, live):
    tune_page(tab, live)
    laps, far = len(requests_of(live, "lap")), tab.js(f"{TUNE}.lap.rms")
    tab.js("document.querySelectorAll('.gain input')[2].focus()")
    for _ in range(4):
        tab.press("PageDown")
    tab.wait(f"{TUNE}.lap.rms > 1.2 * {far}")
    assert len(requests_of(live, "lap")) > laps
    assert not live.words("set")  # nothing that drives has changed
    tab.js(f"{TUNE}.do.downhill.click()")
    tab.wait(f"{TUNE}.values.every((x, k) => Math.abs(x - [0.6, 1.4, 6, 0.2][k]) < 1e-6)")


def test_gains_are_applied_and_restored_by_the_driver(tab, live):
    tune_page(tab, live)
    assert tab.js(f"{TUNE}.do.apply.disabled")
    tab.js(f"{TUNE}.jump([0.5, 2, 8, 0.25])")
    tab.wait(f"!{TUNE}.do.apply.disabled")
    tab.js(f"{TUNE}.do.apply.click()")
    until(lambda: len(live.words("set")) == 2)
    assert {word["path"]: word["value"] for word in live.words("set")} == {
        "controller.k_x": 2,
        "controller.k_chi": 8,
    }
    tab.wait(f"{TUNE}.do.apply.disabled && {TUNE}.state.textContent === 'in use'")
    tab.js(f"{TUNE}.do.undo.click()")
    until(lambda: live.gains == {"controller.k_i": 0.5, "controller.k_x": 1, "controller.k_chi": 4,
                                 "controller.join_m": 0.25})  # fmt: skip
    tab.wait(f"{TUNE}.do.undo.disabled")


def test_a_click_on_the_cost_map_selects_two_gains(tab, live):
    tune_page(tab, live)
    tab.wait(f"Boolean({TUNE}.land)")
    x, y = tab.middle(".land")
    tab.mouse("mousePressed", x, y)
    tab.mouse("mouseReleased", x, y)
    tab.wait(f"{TUNE}.values[2] > 0.1 && {TUNE}.values[2] < 1")
    assert tab.js(f"{TUNE}.values[0]") == 0.5  # the others rest


def test_selected_runs_are_compared_and_the_user_can_return_to_the_list(tab, live):
    open_page(tab, live, screen="runs")
    assert tab.js("document.querySelector('.runs footer .primary').disabled")
    for k in (0, 1):
        tab.js(f"document.querySelectorAll('.runs [type=checkbox]')[{k}].click()")
    tab.js("document.querySelector('.runs footer .primary').click()")
    tab.wait("document.querySelector('.compared .better')?.textContent === '0.010'")
    assert requests_of(live, "compare")[0]["runs"] == ["r0", "r1"]
    tab.js("document.querySelector('.runs header .action').click()")
    tab.wait("document.querySelectorAll('.runs [type=checkbox]').length === 4")


def test_a_long_list_of_runs_has_pages(tab, live):
    open_page(tab, live, screen="runs")
    many = [{"id": f"m{k}", "name": f"run-{k:03}", "kind": "teach"} for k in range(60)]
    live.put({"is": "runs", "runs": many})
    tab.wait("document.querySelectorAll('.runs tbody tr').length === 25")
    for _ in range(2):
        tab.js("document.querySelector('.runs footer').lastChild.click()")
    tab.wait("document.querySelectorAll('.runs tbody tr').length === 10")
    assert tab.js("document.querySelector('.runs footer').lastChild.disabled")


def test_a_block_shows_its_source_and_can_be_checked_and_replaced(tab, live):
    open_page(tab, live, screen="blocks")
    for view, line_shown in ((1, "process_noise_cov"), (2, "line 70 of a file")):
        tab.js(f"document.querySelectorAll('.side .choices button')[{view}].click()")
        tab.wait(f"document.querySelector('.content').textContent.includes({line_shown!r})")
    tab.wait("document.querySelector('.content').scrollTop > 500")
    tab.js("document.querySelector('.side footer .action').click()")
    tab.wait("document.querySelector('.side footer .good')?.textContent.includes('checks')")
    tab.js(
        "(() => { const one = document.querySelector('.other select'); one.value = 'ekf';"
        "one.dispatchEvent(new Event('change')); })()"
    )
    until(lambda: live.words("swap") == [{"is": "swap", "room": "estimator", "kind": "ekf"}])


def test_the_ghost_run_is_aligned_with_the_run_by_marks(tab):
    with ScriptedServer("replay", ghost=True) as server:
        open_page(tab, server)
        tab.wait(f"Boolean({PAGE}.ghost)")
        replay = f"{PAGE}.screens.replay"
        tab.js(f"{PAGE}.ghost.about.events.find((one) => one.source === 'mark').t = 32; {replay}.build()")
        tab.js("[...document.querySelectorAll('.transport .choices button')].at(-1).click()")
        tab.wait(f"{replay}.by === 'mark' && {replay}.pairs?.map[3000] === 3200")


def requests_of(live, subject):
    return [word for word in live.words("ask") if word["what"] == subject]
