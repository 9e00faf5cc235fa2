"""The screen *Drive* in a real browser: its map, numbers, strips and words, compared with the ticks that it shows."""

import numpy as np
import pytest

from tests.web.chromium import CHROMIUM, SIZES
from tests.web.screens import PAGE, check_trace, only, open_page, painted, still_page
from tests.web.scripted import RADIUS
from tests.web.scripted_answers import LIMIT, route

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: sudo apt-get install chromium")


def test_the_map_shows_route_path_corridor_ellipses_and_truth(tab, live):
    """Each point on the canvas, as a place of the map, is compared with the ticks that the vehicle sent."""
    x = still_page(tab, live)
    marks = painted(tab, f"{PAGE}.screen.map.canvas")
    left, top, scale = tab.js(f"(({{ X, Y, view }}) => [X(0), Y(0), view.scale])({PAGE}.screen.map)")

    def places(mark):
        return np.array([[(point[1] - left) / scale, (top - point[2]) / scale] for point in mark["path"]])

    def far(points, *tracks):
        """Return the distance [m] of each point from the nearest place of the tracks."""
        track = np.concatenate(tracks)
        return np.hypot(*(points[:, None] - track).transpose(2, 0, 1)).min(axis=1)

    estimate, truth = (np.column_stack([x[f"{of}.x"], x[f"{of}.y"]]) for of in ("eta", "truth"))
    route = places(only(marks, kind="line", colour="route"))
    np.testing.assert_allclose(np.hypot(route[:, 0], route[:, 1] - RADIUS), RADIUS, atol=1e-6)
    np.testing.assert_allclose(route[0], route[-1], atol=1e-6)  # closed
    limit = places(only(marks, kind="line", colour="alarm", dash=[6, 4]))
    np.testing.assert_allclose(limit, np.column_stack([LIMIT["x"], LIMIT["y"]]), atol=1e-5)
    for track, look in (
        (estimate, {"colour": "model", "width": 2.6, "dash": []}),
        (truth, {"colour": "ink", "dash": [5, 4]}),
    ):
        line = places(only(marks, kind="line", **look))
        assert far(line, track).max() < 1e-5
        assert np.hypot(*(line[[0, -1]] - track[[0, -1]]).T).max() < 0.012  # from the first tick to the last
    n = np.column_stack([-np.sin(x["eta.psi"]), np.cos(x["eta.psi"])])
    P = np.array([[x["P.xx"], x["P.xy"]], [x["P.xy"], x["P.yy"]]]).transpose(2, 0, 1)
    half = 1.96 * np.sqrt(np.einsum("ki,kij,kj->k", n, P, n))[:, None] * n
    corridor = places(only(marks, kind="area", colour="corridor"))
    assert far(corridor[::5], estimate + half, estimate - half).max() < 1e-5
    assert far(estimate[::50] + half[::50], corridor).max() < 0.03  # along all of the path, on both sides
    assert far(estimate[::50] - half[::50], corridor).max() < 0.03
    ellipses = [mark["path"][0] for mark in marks if mark["path"] and mark["path"][0][0] == "ellipse"]
    each_4_s = np.arange(np.ceil(x["t"][0] / 4.0), x["t"][-1] / 4.0 + 1e-9) * 4.0
    ticks = np.searchsorted(x["t"], each_4_s + 1e-6) - 1
    assert len(ellipses) == len(ticks) >= 5
    for (_, px, py, a, b, angle, *_), k in zip(ellipses, ticks, strict=True):
        np.testing.assert_allclose([(px - left) / scale, (top - py) / scale], estimate[k], atol=1e-5)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        shape = turn @ np.diag([a**2, b**2]) @ turn.T / scale**2
        np.testing.assert_allclose(shape, -2.0 * np.log(0.05) * P[k], rtol=1e-3)  # 95 % of two dimensions
    bodies = [(mark, places(mark)[0]) for mark in marks if mark["path"] and mark["path"][0][0] == "box"]
    assert any(
        mark["kind"] == "area" and np.hypot(*(position - estimate[-1])) < 1e-5 for mark, position in bodies
    )
    assert any(
        mark.get("dash") == [4, 3] and np.hypot(*(position - truth[-1])) < 1e-5 for mark, position in bodies
    )


def test_the_map_of_a_vehicle_that_is_ready_shows_the_selected_route(tab, live):
    live.state, live.kind = "READY", None
    open_page(tab, live)
    tab.wait(f"{PAGE}.route.name === 'lab'")
    tab.js(f"(({{ route }}) => {{ route.value = 'oval'; route.onchange(); }})({PAGE}.screens.drive)")
    tab.wait(f"{PAGE}.route.name === 'oval' && Math.max(...{PAGE}.route.x) > 1.9")
    live.go("MISSION", "repeat")
    live.put({"type": "route", **route(), "name": "lab"})
    tab.wait(f"{PAGE}.route.name === 'lab' && {PAGE}.moves")
    live.go("STOPPED")
    tab.wait(f"{PAGE}.state.state === 'STOPPED'")
    assert tab.js(f"{PAGE}.route.name") == "lab"  # what was driven stays


def test_the_three_numbers_on_a_projector_are_read_from_six_heights_of_the_picture(tab, live):
    """Digits of 1/200 of the distance are legible: 3 % of the height; a digit has 0.7 of the size of its font."""
    tab.size(*SIZES["projector"])
    for screen in ("drive", "tune"):
        open_page(tab, live, screen=screen)
        tab.wait("document.querySelectorAll('.numbers .much b').length === 3")
        size = tab.js("parseFloat(getComputedStyle(document.querySelector('.numbers .much b')).fontSize)")
        assert 0.7 * size >= 0.03 * SIZES["projector"][1]


def test_the_drive_screen_shows_three_numbers(tab, live):
    x = {name: column[-1] for name, column in still_page(tab, live).items()}
    shown_texts = tab.js(
        "[...document.querySelectorAll('.drive .much')].map((one) => [...one.children].map((of) => of.textContent))"
    )
    n = np.array([-np.sin(x["eta.psi"]), np.cos(x["eta.psi"])])
    half_width_m = 1.96 * np.sqrt(n @ [[x["P.xx"], x["P.xy"]], [x["P.xy"], x["P.yy"]]] @ n)
    assert [unit for _, unit in shown_texts] == ["cm", "cm", "m/s"]
    assert shown_texts[1][0].startswith("± ")
    numbers = [float(number.removeprefix("± ")) for number, _ in shown_texts]
    exact = [100 * abs(x["cross"]), 100 * half_width_m, np.hypot(x["nu.u"], x["nu.v"])]
    assert np.all(np.abs(np.subtract(numbers, exact)) < [0.051, 0.051, 0.0051])
    assert min(numbers) > 0.1


def test_the_strips_show_measurement_model_innovation_and_command(tab, live):
    x = still_page(tab, live)
    shown_texts = []
    for k in range(tab.js(f"{PAGE}.screen.strips.length")):
        strip = f"{PAGE}.screen.strips[{k}]"
        marks = painted(tab, f"{strip}.canvas")
        low, high, width, height = tab.js(
            f"(({{ low, high, canvas: {{ w, h }} }}) => [low, high, w, h])({strip})"
        )
        traces = tab.js(f"{strip}.traces.map(({{ name, kind }}) => [name, kind])")
        texts = tab.js(f"{strip}.values.map((one) => one.textContent)")
        looks = {"measured": "measured", "model": "model", "applied": "ink", "requested": "ghost"}
        for (name, kind), text in zip(traces, texts, strict=True):
            dash = [4, 3] if kind == "requested" else []
            line = only(marks, kind="line", colour=looks[kind], dash=dash)
            check_trace(line, [low, high, height], x, name, 20.0)
            assert line["path"][-1][1] > width - 2  # up to now
            assert float(text.replace("−", "-")) == pytest.approx(x[name][-1], rel=0.006, abs=6e-4)
            shown_texts.append((name, kind))
        if band := [mark for mark in marks if mark.get("dash") == [2, 2]]:
            std = x[traces[0][0].replace("innov", "S")][-1]
            edges = [low + (height - 3 - mark["path"][0][2]) / (height - 6) * (high - low) for mark in band]
            assert sorted(edges) == pytest.approx([-1.96 * std, 1.96 * std], rel=1e-3)
            assert only(marks, kind="area", colour="band")
            shown_texts.append((traces[0][0], "band"))
    assert shown_texts == [
        *((f"{of}.imu[{k}]", kind) for k in range(3) for of, kind in (("z", "measured"), ("model", "model"))),
        *((f"innov.imu[{k}]", kind) for k in range(3) for kind in ("measured", "band")),
        *((f"{of}.{k}", kind) for k in (0, 2) for of, kind in (("u", "applied"), ("requested", "requested"))),
    ]


HONESTY = {  # the mean NIS of 10 s, of three channels: the band is 1 ± 0.051
    "en": {
        "below": "errors are smaller than the covariance",
        "inside": "covariance agrees with the errors",
        "above": "errors are larger than the covariance",
        "unknown": "needs 2 s of driving",
    },
    "es": {
        "below": "errores son menores que los que predice",
        "inside": "covarianza concuerda con los errores",
        "above": "errores son mayores que los que predice",
        "unknown": "necesita 2 s de marcha",
    },
}


@pytest.mark.parametrize("language", HONESTY)
def test_the_filter_consistency_is_stated_in_words(tab, live, language):
    still_page(tab, live, language)
    card = "document.querySelector('.nis')"
    for nis, kind, colour in (
        (0.94, "below", "sim"), (0.96, "inside", "model"), (1.04, "inside", "model"), (1.06, "above", "alarm"),
    ):  # fmt: skip
        tab.js(f"{PAGE}.record.column('nis').fill({nis})")
        marks = painted(tab, "document.querySelector('.nis canvas')")
        assert tab.js(f"{card}.dataset.kind") == kind
        text = tab.js(f"{card}.textContent")
        assert HONESTY[language][kind] in text
        assert f"NIS {nis:.2f}".replace(".", "," if language == "es" else ".") in text
        assert only(marks, kind="line", colour=colour)
        assert only(marks, kind="area", colour="band")
    tab.js(f"{PAGE}.record.length = 150")
    painted(tab, "document.querySelector('.nis canvas')")
    assert HONESTY[language]["unknown"] in tab.js(f"{card}.textContent")


LONG = """(async () => {
  const { Record, trailsOf } = await import("/static/record.js"), n = 60000, names = ["t", "eta.x", "eta.y"];
  const record = new Record(names.map((name) => ({ name })), 0, false), rows = new Float32Array(3 * n);
  for (let k = 0; k < n; k++) rows.set([0.01 * k, 0.0025 * k, Math.sin(0.01 * k)], 3 * k);
  record.add(rows, n);
  const { points } = trailsOf(record, { footprint: { width_m: 0.14 } }).path.update();
  const steps = points.slice(1).map(([x], k) => x - points[k][0]);
  return [points.length, points[0][2], points.at(-1)[2], Math.max(...steps)];
})()"""


def test_a_path_of_ten_minutes_has_few_points_of_which_none_is_far_from_the_next(tab, live):
    open_page(tab, live)
    number, first, last, step_m = tab.js(LONG)
    assert 1000 <= number <= 2000
    assert first == 0
    assert last > 59_900
    assert step_m < 0.3
