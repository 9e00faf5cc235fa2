"""The screens that use a worker, in a real browser with a script: gains, blocks, comparisons."""

import pytest

from tests.web.chromium import CHROMIUM
from tests.web.screens import PAGE, check_trace, open_page, painted, still_page, until
from tests.web.scripted import ScriptedServer

TUNE = f"{PAGE}.screens.tune"

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")


def tune_page(tab, live):
    open_page(tab, live, screen="tune")
    tab.press("l", "KeyL", "l")
    tab.wait(f"{PAGE}.hand.mine && Boolean({TUNE}.lap)")


def test_each_slider_move_simulates_a_lap_and_a_descent_is_shown(tab, live):
    tune_page(tab, live)
    laps, rms_m = len(requests_of(live, "lap")), tab.js(f"{TUNE}.lap.rms")
    tab.js("document.querySelectorAll('.gain input')[2].focus()")
    for _ in range(4):
        tab.press("PageDown")
    tab.wait(f"{TUNE}.lap.rms > 1.2 * {rms_m}")
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
    runs = [{"id": f"m{k}", "name": f"run-{k:03}", "kind": "teach"} for k in range(60)]
    live.put({"type": "runs", "runs": runs})
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
    until(lambda: live.words("swap") == [{"type": "swap", "room": "estimator", "kind": "ekf"}])


WIRES = [  # of the diagram in README.md
    ("vehicle", "sensors"), ("sensors", "estimator"), ("estimator", "guide"), ("guide", "controller"),
    ("estimator", "controller"), ("controller", "supervisor"), ("supervisor", "vehicle"),
]  # fmt: skip
SPARKS = {  # title of a wire: its signals
    "measurement": ["z.imu[0]", "z.imu[1]", "z.imu[2]"], "estimate": ["eta.x", "eta.y"],
    "reference": ["ref.x", "ref.y"], "requested command": ["requested.0", "requested.2"], "command": ["u.0", "u.2"],
}  # fmt: skip
BOX = """((name) => {
  const canvas = document.querySelector('.wires').getBoundingClientRect();
  const box = document.querySelector(`.block.at-${name}`).getBoundingClientRect();
  return [box.left - canvas.left, box.top - canvas.top, box.right - canvas.left, box.bottom - canvas.top];
})"""


def is_on_border(box, point):
    left, top, right, bottom = box
    _, x, y = point
    is_inside = left - 2 <= x <= right + 2 and top - 2 <= y <= bottom + 2
    return is_inside and min(abs(x - left), abs(x - right), abs(y - top), abs(y - bottom)) <= 2


def test_each_wire_of_the_diagram_joins_its_blocks_and_shows_its_signals(tab, live):
    x = still_page(tab, live, "en", "blocks")
    marks = painted(tab, "document.querySelector('.wires')")
    starts = [mark["path"][0] for mark in marks if mark["kind"] == "line"]
    tips = [mark["path"][0] for mark in marks if mark["kind"] == "area"]
    boxes = {name: tab.js(f"{BOX}({name!r})") for wire in WIRES for name in wire}
    joined_runs = [
        tuple(next(name for name, box in boxes.items() if is_on_border(box, point)) for point in ends)
        for ends in zip(starts, tips, strict=True)
    ]
    assert joined_runs == WIRES
    sparks = f"{PAGE}.screen.sparks"
    titles = tab.js(f"{sparks}.map((one) => one.node.querySelector('b').textContent)")
    assert titles == list(SPARKS)
    for k, names in enumerate(SPARKS.values()):
        marks = painted(tab, f"{sparks}[{k}].canvas")
        assert [mark["colour"] for mark in marks] == ["measured", "model", "ghost"][: len(names)]
        scale = tab.js(f"(({{ low, high, canvas }}) => [low, high, canvas.h])({sparks}[{k}])")
        shown_values = tab.js(f"{sparks}[{k}].values.map((one) => one.textContent)")
        for name, mark, text in zip(names, marks, shown_values, strict=True):
            check_trace(mark, scale, x, name, 10.0)
            assert float(text.replace("−", "-")) == pytest.approx(x[name][-1], rel=0.006, abs=6e-4)
    tab.js(f"{PAGE}.record.length = 0")  # as before the first drive
    assert len(painted(tab, "document.querySelector('.wires')")) == 2 * len(WIRES)


def test_a_click_on_a_block_of_the_diagram_shows_the_block_and_the_time_of_its_step(tab, live):
    open_page(tab, live, screen="blocks")
    tab.wait("document.querySelector('.block.at-controller i').textContent === '21.4 µs'")
    for name, strips in (("controller", 2), ("sensors", 3)):
        tab.click(f".block.at-{name}")
        assert tab.js("document.querySelector('.side h2').textContent") == name
        assert tab.js(f"document.querySelector('.block.at-{name}').ariaPressed") == "true"
        assert tab.js("document.querySelectorAll('.content .strip').length") == strips
    assert {word["room"] for word in requests_of(live, "block")} >= {"controller", "sensors"}


def test_the_ghost_run_is_aligned_with_the_run_by_marks(tab):
    with ScriptedServer("replay", ghost=True) as server:
        open_page(tab, server)
        tab.wait(f"Boolean({PAGE}.ghost)")
        replay = f"{PAGE}.screens.replay"
        tab.js(f"{PAGE}.ghost.about.events.find((one) => one.source === 'mark').t = 32; {replay}.build()")
        tab.js("[...document.querySelectorAll('.transport .choices button')].at(-1).click()")
        tab.wait(f"{replay}.by === 'mark' && {replay}.pairs?.map[3000] === 3200")


def test_a_run_is_shown_beside_the_same_data_through_another_filter(tab, replay):
    open_page(tab, replay)
    choice = f"{PAGE}.screens.replay.filter"
    tab.wait(f"{choice}?.options.length > 1")
    kind = tab.js(f"{choice}.options[1].value")
    tab.js(f"((one) => {{ one.value = {kind!r}; one.dispatchEvent(new Event('change')); }})({choice})")
    tab.wait(f"{PAGE}.ghost?.about.filter === {kind!r}")
    tab.wait(f"document.body.innerText.includes('{kind} · same data')")
    tab.wait("document.querySelectorAll('.compare tbody tr').length === 4")


def requests_of(live, subject):
    return [word for word in live.words("ask") if word["question"] == subject]
