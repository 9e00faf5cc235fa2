"""States of the screens that a person reaches by a click: the lease, the dialog, the views of a block, a comparison."""

import re

import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.screens import AXE, BOXES, LIVE, PAGE, axe, looked_at, open_page, shot, until

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")
MESSAGE = (  # longer than most
    "Otra persona maneja este vehículo desde otro navegador: pídale el volante, o espere hasta que lo suelte. Nada se "
    "movió."
)
LOOKS = [("phone", "light"), ("laptop", "dark"), ("projector", "light")]
VIEWS = "document.querySelectorAll('.side .choices button')"
ODD = {
    "en": "gyro drifts, it does not fit the model",
    "es": "deriva el giróscopo, no concuerda con el modelo",
}


def states(tab, live):
    """Yield the name of each state of a page whose user drives, in Spanish, whose texts are longer."""
    open_page(tab, live, "es")
    tab.click("#lease")
    tab.wait(f"{PAGE}.hand.mine")
    live.put(live._state("es") | {"warnings": [ODD["es"]], "severity": "warning"})
    tab.wait(f"document.getElementById('text').textContent.includes({ODD['es']!r})")
    yield "lease and warnings"
    tab.js(
        f"Object.assign(document.getElementById('toast'), {{ textContent: {MESSAGE!r}, className: 'shown' }})"
    )
    yield "message"
    tab.js("document.getElementById('toast').className = ''")
    tab.click("#help")
    yield "dialog"
    tab.click("#close")
    tab.click("#tab-blocks")
    tab.wait(f"Boolean({PAGE}.screens.blocks.details.estimator?.text)")
    for k, view in enumerate(("signals", "parameters", "source")):
        tab.js(f"{VIEWS}[{k}].click()")
        yield view
    tab.js("document.querySelector('.side footer .action').click()")
    tab.wait("Boolean(document.querySelector('.side footer .good'))")
    yield "checked"
    tab.click("#tab-runs")
    for k in range(3):
        tab.js(f"document.querySelectorAll('.runs [type=checkbox]')[{k}].click()")
    tab.js("document.querySelector('.runs footer .primary').click()")
    tab.wait("Boolean(document.querySelector('.compared .better'))")
    yield "compared"


def test_no_state_of_a_screen_has_a_layout_fault(tab, live):
    faults = {}
    for state in states(tab, live):
        for size, theme in LOOKS:
            looked_at(tab, size, theme)
            shot(tab, "state", state, size, theme)
            if problems := [*tab.js(BOXES), *(axe(tab)["violations"] if AXE.is_file() else ())]:
                faults[f"{state} {size}"] = problems
        looked_at(tab, "laptop", "light")
    assert not faults
    assert not tab.errors


def test_a_message_covers_no_control(tab, live):
    covered_buttons = """[...document.querySelectorAll("button, select, input, .pad")].filter((one) => {
      const a = one.getBoundingClientRect(), b = document.getElementById("toast").getBoundingClientRect();
      return one.checkVisibility() && a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    }).map((one) => one.id || one.textContent)"""
    open_page(tab, live, "es")
    for size in SIZES:
        tab.size(*SIZES[size])
        live.put({"type": "event", "t": 1.0, "severity": "warning", "text": MESSAGE})
        tab.wait("document.getElementById('toast').getBoundingClientRect().height > 10")
        assert tab.js(covered_buttons) == [], size


def test_the_stop_button_has_the_same_position_on_every_screen_of_a_size(tab, live):
    open_page(tab, live)
    node = "document.getElementById('stop')"
    box = f"(({{ x, y, width, height }}) => [x, y, width, height])({node}.getBoundingClientRect())"
    for size, (width, height) in SIZES.items():
        tab.size(width, height)
        places = []
        for screen in LIVE:
            tab.js(f"{PAGE}.open({screen!r})")
            places.append(tab.js(box))
            x, y, box_width, high = places[-1]
            top = tab.js(
                f"document.elementFromPoint({x + box_width / 2}, {y + high / 2}).closest('button')?.id"
            )
            assert top == "stop", (size, screen)  # nothing lies over it
            assert 0 <= x <= x + box_width <= width
            assert 0 <= y <= y + high <= height
        assert places == places[:1] * len(LIVE), size
        assert tab.js("document.querySelectorAll('#stop').length") == 1
    tab.size(*SIZES["phone"])
    assert tab.js(box)[2] > 300  # across the whole width, under the thumb


def test_on_a_phone_the_numbers_of_a_run_are_above_its_controls(tab, live):
    """The vehicle is stopped, and an event is shown: all parts are as high as they become."""
    tab.size(*SIZES["phone"])
    open_page(tab, live, "es")
    live.put(live._state("es") | {"state": "STOPPED"})
    tab.js(f"{PAGE}.openRun({PAGE}.runs[0].id)")
    tab.wait(f"Boolean({PAGE}.opened)")
    tab.js(f"{PAGE}.screens.replay.seek({PAGE}.opened.about.events[0].t + 0.1)")
    tab.wait("Boolean(document.querySelector('.happened').textContent)")
    box = "document.querySelector({!r}).getBoundingClientRect()".format
    tab.wait(
        f"!document.getElementById('clear').hidden && {box('.numbers')}.bottom <= {box('.transport')}.top"
    )


@pytest.mark.parametrize("language", ODD)
def test_the_sentence_states_a_warning_and_the_accuracy(tab, live, language):
    open_page(tab, live, language)
    live.put(live._state(language) | {"warnings": [ODD[language]], "severity": "warning"})
    tab.wait(f"document.getElementById('text').textContent.endsWith({ODD[language]!r})")
    assert tab.js("document.getElementById('sentence').dataset.severity") == "warning"
    assert "2,5 cm" in tab.js("document.getElementById('text').textContent").replace("2.5", "2,5")
    live.put(live._state(language))
    tab.wait(f"!document.getElementById('text').textContent.includes({ODD[language]!r})")
    assert tab.js("document.getElementById('sentence').dataset.severity") == "info"


def test_each_robot_has_a_bar_of_its_own_colour_that_is_never_red(tab, live, monkeypatch):
    hues = []
    hello = live._hello
    for robot in ("00000000", "7f3aaaaa", "ffff0000"):
        monkeypatch.setattr(live, "_hello", lambda language, robot=robot: hello(language) | {"robot": robot})
        open_page(tab, live)
        red, green, blue = map(
            int,
            re.findall(r"\d+", tab.js("getComputedStyle(document.getElementById('vehicle')).borderColor"))[
                :3
            ],
        )
        assert red < max(green, blue) + 60, robot
        hues.append((red, green, blue))
    assert len(set(hues)) == 3


def test_a_block_shows_the_unit_of_each_parameter_and_signal(tab, live):
    open_page(tab, live, screen="blocks")
    tab.js(f"{VIEWS}[1].click()")
    tab.wait("document.querySelectorAll('.content tr').length === 2")
    cells = tab.js("[...document.querySelectorAll('.content td')].map((one) => one.textContent)")
    assert cells == ["1.00 1/s", "6 × 6 m²"]
    units = "[...document.querySelectorAll('.content .unit')].map((one) => one.textContent)"
    expected = {
        "vehicle": ["m/s", "rad/s"],
        "sensors": ["m/s²", "m/s²", "rad/s"],
        "controller": ["duty", "duty"],
    }
    tab.js(f"{VIEWS}[0].click()")
    for block, of_strips in expected.items():
        tab.click(f".block.at-{block}")
        assert tab.js(units) == of_strips


@pytest.mark.parametrize("size", SIZES)
def test_while_the_list_of_keys_is_open_the_stop_button_works_and_no_key_drives(tab, live, size):
    tab.size(*SIZES[size])
    open_page(tab, live)
    tab.click("#lease")
    tab.wait(f"{PAGE}.hand.mine")
    tab.down("w", "KeyW", "w")
    until(lambda: any(beat["u"][0] > 0 for beat in live.words("beat")))
    tab.press("?", "Slash", "?", shift=True)
    tab.wait("document.getElementById('keys').open")
    until(lambda: not any(live.words("beat")[-1]["u"]))
    tab.up("w", "KeyW")  # in the list
    tab.click("#stop")
    until(lambda: live.words("stop"))
    tab.press("Escape", "Escape")
    tab.wait("!document.getElementById('keys').open")
