"""Manual control on the page: a game pad, the buttons of a drive, its pace, and each fault button."""

import time

import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.screens import PAGE, open_page, until
from tests.web.scripted import ScriptedServer

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")

PAD = """globalThis.gamePad = {
  connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 16 }, () => ({ pressed: false })),
};
navigator.getGamepads = () => [null, globalThis.gamePad]"""
FAULTS = [  # kind, choice of its list, fields that the ledger must hold
    ("cut", None, {"target": "imu"}),
    ("drift", 0, {"target": "imu[2]", "size": 0.15}),
    ("drift", 2, {"target": "imu[2]", "size": 0.5}),
    ("spikes", 1, {"target": "imu[0]", "size": 20, "part": 0.02}),
    ("slip", 0, {"target": "left", "part": 0.3}),
    ("slip", 2, {"target": "all", "part": 0.3}),
    ("sag", 1, {"part": 0.7}),
    ("lose", 1, {"part": 0.6}),
]
LATEST = {
    "number": 1, "t_s": 60.0, "until_s": None, "ended": False, "fault": {"kind": "sag"}, "text": "sag",
    "detections": [], "missed_by": ["NIS", "monitor"], "undetected": None,
}  # fmt: skip
LAST = f"{PAGE}.ledger.at(-1)"


@pytest.fixture
def pad_of_phone(tab, live):
    """Return the middle of the touch pad on a phone that controls a driving vehicle."""
    tab.size(*SIZES["phone"])
    tab.do("Emulation.setTouchEmulationEnabled", enabled=True)
    open_page(tab, live)
    tab.click("#lease")
    tab.wait(f"{PAGE}.hand.mine")
    tab.js("document.querySelector('.pad').scrollIntoView({ block: 'nearest' })")
    return tab.middle(".pad")


@pytest.fixture
def breaking(driver, live):
    """Return the tab of the driver at the faults, before any fault."""
    live.put({"type": "ledger", "rows": []})
    driver.click("#tab-faults")
    driver.wait(f"{PAGE}.ledger.length === 0")
    return driver


def command(live):
    beats = live.words("beat")
    return beats[-1]["u"] if beats else None


def test_a_game_pad_drives_beyond_its_dead_zone_until_it_is_unplugged(driver, live):
    driver.js(PAD)
    driver.js("gamePad.axes[1] = -1")
    until(lambda: command(live) == [0.5, 0, 0])  # half of the command at full stick
    driver.js("gamePad.axes[2] = -1")  # the right stick turns to the left
    until(lambda: command(live) == [0.5, 0, 0.5])
    driver.js("gamePad.axes[2] = 0; gamePad.axes[0] = 0.55")  # the left one turns as well, half as far
    until(lambda: command(live) == [0.5, 0, pytest.approx(-0.25)])
    driver.js("gamePad.axes = [0.09, -0.09, 0, 0]")
    until(lambda: command(live) == [0, 0, 0])
    driver.js("gamePad.axes[1] = -1")
    until(lambda: command(live) == [0.5, 0, 0])
    assert not live.words("give")
    driver.js("gamePad.connected = false; dispatchEvent(new Event('gamepaddisconnected'))")
    until(lambda: live.words("give"))
    assert command(live) == [0, 0, 0]


def test_a_game_pad_drives_three_commands_with_two_sticks(driver, live):
    driver.js(PAD)
    driver.js(f"Object.assign({PAGE}.hello.vehicle.command[1], {{ low: -1, high: 1 }})")
    driver.js("gamePad.axes = [-1, -1, 1, 0]")
    until(lambda: command(live) == [0.5, 0.5, -0.5])
    driver.js("gamePad.axes = [0, 0, 0, 0]")
    driver.down("a", "KeyA", "a")  # keys turn it
    until(lambda: command(live) == [0, 0, 0.5])
    driver.up("a", "KeyA")


def test_a_frame_that_is_not_drawn_is_not_named_by_a_heartbeat(driver, live):
    until(lambda: live.words("beat"))
    driver.js("globalThis.requestAnimationFrame = () => 0")  # nothing is drawn, but frames arrive
    time.sleep(0.1)
    frame_count, beats = driver.js(f"{PAGE}.link.frame"), len(live.words("beat"))
    driver.wait(f"{PAGE}.link.number > {frame_count} + 5")
    assert len(live.words("beat")) == beats
    driver.js("dispatchEvent(new Event('pagehide'))")
    until(lambda: live.words("give"))
    assert [beat["frame"] for beat in live.words("beat")[beats:]] == [frame_count]


def test_a_finger_on_the_touch_pad_drives_until_it_is_lifted_or_interrupted(tab, live, pad_of_phone):
    x, y = pad_of_phone
    for end in ("touchEnd", "touchCancel"):
        tab.touch("touchStart", (x, y))
        tab.touch("touchMove", (x, y - 20))
        tab.touch("touchMove", (x, y - 40))
        until(lambda: command(live)[0] > 0.3 and abs(command(live)[2]) < 0.05)
        tab.touch("touchMove", (x - 40, y))
        until(lambda: abs(command(live)[0]) < 0.05 and command(live)[2] > 0.3)
        assert not live.words("give")
        tab.touch(end)
        until(lambda: command(live) == [0, 0, 0])
    until(lambda: live.words("give"))  # the system took the finger away


def test_a_second_finger_stops_while_the_first_one_drives(tab, live, pad_of_phone):
    x, y = pad_of_phone
    tab.touch("touchStart", (x, y))
    tab.touch("touchMove", (x, y - 40))
    until(lambda: command(live)[0] > 0.3)
    tab.touch("touchStart", (x, y - 40), tab.middle("#stop"))
    until(lambda: live.words("stop"))
    until(lambda: command(live) == [0, 0, 0])  # and the first finger drives no more


def test_the_second_game_pad_button_stops_without_the_lease(tab, live):
    open_page(tab, live)
    tab.js(PAD)
    tab.js("gamePad.buttons[0].pressed = true")
    tab.wait("new Promise((done) => setTimeout(() => done(true), 200))")
    assert not live.words("stop")
    tab.js("gamePad.buttons[1].pressed = true")
    until(lambda: live.words("stop"))
    tab.wait("document.getElementById('title').textContent === 'STOPPED'")
    assert len(live.words("stop")) == 1  # for one press
    assert not live.words("take")


def test_the_buttons_for_pause_continue_mark_and_end_work(driver, live):
    button = "[...document.querySelectorAll('.drive .action')].find((one) => one.code === 'Key{}')"
    driver.js(f"{button.format('M')}.click()")
    until(lambda: live.words("mark"))
    driver.js(f"{button.format('P')}.click()")
    until(lambda: live.words("pause"))
    driver.wait(f"{button.format('P')}.textContent.startsWith('Continue')")
    driver.press("p", "KeyP", "p")  # its key has the same effect
    until(lambda: live.words("go") == [{"type": "go"}])
    driver.wait(f"{button.format('P')}.textContent.startsWith('Pause')")
    driver.js(f"{button.format('E')}.click()")
    until(lambda: live.words("end"))
    assert [len(live.words(word)) for word in ("mark", "pause", "end")] == [1, 1, 1]


def test_the_pace_slider_shows_the_pace_of_the_drive(tab):
    with ScriptedServer("live") as live:
        live.pace = 4.0  # as in the demo
        open_page(tab, live)
        pace = "document.querySelector('.pace').textContent"
        assert tab.js(pace) == "pace 4×"
        tab.js("document.querySelector('.pace input').focus()")
        tab.press("ArrowRight")
        until(lambda: live.words("pace") == [{"type": "pace", "factor": 8}])
        for _ in range(5):
            tab.press("ArrowLeft")
        until(lambda: live.words("pace")[-1] == {"type": "pace", "factor": 0.25})
        tab.wait(f"{pace} === 'pace ¼×'")


def breaker(kind: str) -> str:
    return f"{PAGE}.screens.faults.breakers.find((one) => one.kind === {kind!r})"


@pytest.mark.parametrize(("kind", "choice", "fields"), FAULTS)
def test_each_fault_button_logs_and_ends_its_fault(breaking, live, kind, choice, fields):
    """The script refuses an unknown fault, as the service does."""
    if choice is not None:
        breaking.js(f"{breaker(kind)}.node.querySelector('select').selectedIndex = {choice}")
    breaking.js(f"{breaker(kind)}.button.click()")
    breaking.wait(f"{LAST}?.fault.kind === {kind!r} && !{LAST}.ended && {PAGE}.ledger.length === 1")
    fault = breaking.js(f"{LAST}.fault")
    assert {name: fault[name] for name in fields} == fields
    breaking.wait(f"{breaker(kind)}.button.getAttribute('aria-checked') === 'true'")
    assert breaking.js("document.querySelector('.ledger .fault b').textContent") == breaking.js(
        f"{LAST}.text"
    )
    breaking.js(f"{breaker(kind)}.button.click()")
    breaking.wait(f"{LAST}.ended && {breaker(kind)}.button.getAttribute('aria-checked') === 'false'")


def test_the_floor_is_tilted_and_levelled_by_keys(breaking, live):
    breaking.js("document.querySelector('.tilt .pad').focus()")
    for key in ("ArrowUp", "ArrowRight"):
        breaking.press(key)
    breaking.wait(f"{LAST}?.fault.kind === 'tilt' && {PAGE}.ledger.length === 2")
    # 0.5° each
    assert breaking.js(f"[{LAST}.fault.x, {LAST}.fault.y]") == pytest.approx([0.00873, 0.00873], abs=1e-4)
    assert breaking.js("document.querySelector('.tilt output').textContent") == "0.7°"
    breaking.js("document.querySelector('.tilt button').click()")
    breaking.wait(f"{PAGE}.ledger.length === 3 && {LAST}.fault.x === 0 && {LAST}.fault.y === 0")


def test_keys_and_buttons_send_a_push_a_single_tick_and_a_pace(breaking, live):
    breaking.press("ArrowLeft", shift=True)
    breaking.wait(f"{LAST}?.fault.kind === 'push'")
    assert breaking.js(f"[{LAST}.fault.x, {LAST}.fault.y, {LAST}.fault.frame]") == [-0.2, 0, "map"]
    breaking.press("n", "KeyN", "n")
    until(lambda: live.words("go") == [{"type": "go", "ticks": 1}])
    for k, factor in enumerate((0.125, 0.25, 1, 4)):
        breaking.js(f"document.querySelectorAll('.fault-bar .choices button')[{k}].click()")
        until(lambda factor=factor: live.words("pace") and live.words("pace")[-1]["factor"] == factor)
    breaking.js("document.querySelector('.fault-bar .again').click()")
    until(lambda: live.words("again"))
    assert live.words("again")[0]["without"] == [1]


LEDGER = """[...document.querySelectorAll('.ledger li')].map((one) =>
  ['.fault b', '.detected', '.undetected', '.missed'].map((part) => one.querySelector(part)?.textContent ?? null))"""


@pytest.mark.parametrize(
    ("language", "drift", "push", "detections", "misses", "missed_push"),
    [
        ("en", "zero of imu[2] drifts by 0.15 rad/s", "push of 0.12 N s to the left", "NIS after 0.02 s: its mean",
         "not detected for 5.0 s: NIS at most 1.05.", "not detected by: monitor, supervisor"),
        ("es", "el cero de imu[2] deriva 0,15 rad/s", "empujón de 0,12 N s hacia la izquierda",
         "NIS a los 0,02 s: su media", "sin detectar durante 5,0 s: NIS a lo sumo 1,05.",
         "no la detectaron: monitor, supervisor"),
    ],
    ids=["en", "es"],
)  # fmt: skip
def test_the_ledger_shows_what_detected_a_fault_and_what_did_not(
    tab, live, language, drift, push, detections, misses, missed_push
):
    open_page(tab, live, language, "faults")
    until(lambda: tab.js(LEDGER))
    rows = tab.js(LEDGER)
    assert [row[0] for row in rows[:2]] == [drift, push]  # the newest first
    assert rows[0][1] is None
    assert rows[0][2].startswith(misses)
    assert rows[0][3] is None
    assert rows[1][1].startswith(detections)
    assert rows[1][2:] == [None, missed_push]
    live.put({"type": "ledger", "rows": [LATEST]})
    waits = {"en": "not detected so far", "es": "sin detectar hasta ahora"}[language]
    until(lambda: [row[1:] for row in tab.js(LEDGER)] == [[None, None, waits]])


def test_a_fault_button_has_no_effect_without_the_lease(tab, live):
    open_page(tab, live, screen="faults")
    tab.js(f"{breaker('cut')}.button.click()")
    tab.wait("document.getElementById('toast').classList.contains('shown')")
    assert not live.words("shake")


@pytest.mark.parametrize(("language", "words"), [("en", "open Wi-Fi"), ("es", "Wi-Fi abierta")])
def test_a_shared_page_shows_a_warning_about_its_risk(tab, language, words):
    with ScriptedServer("live") as live:
        live.shared = True
        open_page(tab, live, language)
        assert tab.js("document.getElementById('shared').checkVisibility()")
        assert words in tab.js("document.getElementById('shared').textContent")
        live.shared = False
        open_page(tab, live, language)
        assert not tab.js("document.getElementById('shared').checkVisibility()")
