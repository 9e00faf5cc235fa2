"""Draw a scene and the stages of a fit as SVG, animated by CSS keyframes, so that the SVG also moves in an <img>.

A reader who has switched off animations sees the last instant, which is the state of each element without its
keyframes.
"""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import pairwise

import numpy as np

from baqueano.messages.language import number, translate as _
from baqueano.report.animation.partial_fits import PartialFit
from baqueano.report.animation.scene import Scene

WIDTH_PX, HEIGHT_PX, MAP_SIZE_PX, MARGIN = 860, 430, 440, 26  # of the picture; of the part with the path
FIT_S, LAP_S, MAX_LAPS_S, REST_S = 4.0, 3.4, 11.0, 2.6  # the fit, a lap, all laps, the end
# the largest error that is drawn, relative to the truth; half an axis and a row in px
BAR, AXIS, ROW = 0.2, 96.0, 29.0
FADE_S = 0.15  # of an element that appears or disappears
STYLE = """
svg{font:14px system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif;--paper:#fff;--ink:#1d2128;
--soft:#6b7280;--rule:#d0d5dc;--model:#238b45;--warn:#b45309}
@media(prefers-color-scheme:dark){svg{--paper:#12161c;--ink:#e6e9ee;--soft:#9aa4b2;--rule:#3a4350;--model:#4cc26f;
--warn:#e9a23b}}
text{fill:var(--ink)}.soft{fill:var(--soft)}.title{font-weight:600;font-size:16px}.large{font-size:22px;font-weight:600}
.good{fill:var(--model);font-weight:600}.warn{fill:var(--warn);font-weight:600}
.route{fill:none;stroke:var(--rule);stroke-width:7;stroke-linejoin:round;stroke-linecap:round}
.band{fill:var(--model);opacity:.22}.true,.sure{fill:none;stroke:var(--ink);stroke-width:2.2;stroke-linecap:round}
.sure{stroke:var(--model)}.body{fill:var(--paper);stroke:var(--ink);stroke-width:2.2}.wheel{fill:var(--ink)}
.ghost{fill:none;stroke:var(--model);stroke-width:2;stroke-dasharray:4 3}
.bar{fill:var(--model)}.axis{stroke:var(--rule)}.zero{stroke:var(--ink);stroke-dasharray:2 3}
.gone{opacity:0}
@media(prefers-reduced-motion:reduce){*{animation:none!important}}
"""


def animation(scene: Scene, partial_fits: Sequence[PartialFit] = (), labels: Sequence[str] = ()) -> str:
    """Return the SVG of a scene, with the stages of a fit beside it; `labels` name its parameters."""
    clock = _Clock(scene, bool(partial_fits))
    parts = [
        *_path(scene, clock),
        *_readout(scene, clock, 312 if partial_fits else 120),
        *_legend(scene, 374 if partial_fits else 220),
    ]
    if partial_fits:
        parts += _fit_parts(partial_fits, labels, clock)
    keyframes = "".join(f"@keyframes {name}{{{steps}}}" for name, steps in clock.frames.items())
    title = _("A taught path, driven again; shaded: where the vehicle may be, 95 %")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" role="img">'
        f"<title>{escape(title)}</title><style>{STYLE}{keyframes}</style>"
        f'<rect width="{WIDTH_PX}" height="{HEIGHT_PX}" rx="12" fill="var(--paper)"/>{"".join(parts)}</svg>\n'
    )


class _Clock:
    """The time axis of the animation: fit and teaching, the laps, a pause. Then the animation repeats."""

    def __init__(self, scene: Scene, has_lesson: bool) -> None:
        self.begin_s = FIT_S if has_lesson else 0.6
        self.laps_s = min(LAP_S * scene.laps, MAX_LAPS_S)
        self.period_s = self.begin_s + self.laps_s + REST_S
        self.frames: dict[str, str] = {}
        self._end_s = float(scene.t_s[-1])

    def picture_time_s(self, t_s: float) -> float:
        """Return the time in the animation [s] at the instant `t_s` of the run."""
        return self.begin_s + self.laps_s * t_s / self._end_s

    def percentage(self, picture_s: float) -> str:
        return f"{100.0 * min(picture_s / self.period_s, 1.0):.2f}%"

    def animate(self, name: str, steps: Iterable[tuple[float, str]]) -> str:
        """Add keyframes (seconds, CSS), and return the style that plays them."""
        self.frames[name] = "".join(f"{self.percentage(s)}{{{css}}}" for s, css in steps)
        return f"animation:{name} {self.period_s:g}s linear infinite"

    def show_between(self, name: str, from_s: float, to_s: float) -> str:
        """Return the style of an element that appears at `from_s` and disappears at `to_s`.
        An element that lasts to the end stays visible.
        """
        end_s = self.period_s if to_s >= self.period_s else to_s
        steps = [(0.0, "opacity:0"), (from_s, "opacity:0"), (min(from_s + FADE_S, end_s), "opacity:1")]
        steps += ([(end_s, "opacity:1")] if end_s >= self.period_s else
                  [(end_s, "opacity:1"), (end_s + FADE_S, "opacity:0"), (self.period_s, "opacity:0")])  # fmt: skip
        return self.animate(name, steps)


class _Map:
    """The conversion from metres to the picture: x to the right, y up, the same scale for both."""

    def __init__(self, scene: Scene) -> None:
        poses_list = [
            poses[:, :2]
            for poses in (scene.estimated_poses, scene.true_poses, scene.route)
            if poses is not None
        ]
        xy = np.concatenate(poses_list)
        max_half_width_m = 0.0 if scene.half_m is None else float(np.nanmax(scene.half_m, initial=0.0))
        margin_m = max(scene.radius_m, max_half_width_m) * 1.15
        low, high = xy.min(axis=0) - margin_m, xy.max(axis=0) + margin_m
        self.scale = float(
            min((MAP_SIZE_PX - MARGIN) / (high[0] - low[0]), (HEIGHT_PX - 2 * MARGIN) / (high[1] - low[1]))
        )
        self._middle = (low + high) / 2

    def __call__(self, xy: np.ndarray) -> np.ndarray:
        """Return the position (…, 2) in the picture [px]."""
        centre = np.array([(MAP_SIZE_PX + MARGIN) / 2 + 6, HEIGHT_PX / 2])
        return centre + self.scale * (xy - self._middle) * np.array([1.0, -1.0])

    def pose(self, eta: np.ndarray, turned_deg: float) -> str:
        """Return the CSS transform of a body at this pose, with the unwrapped heading `turned_deg` [°]."""
        x, y = self(eta[:2])
        return f"transform:translate({x:.1f}px,{y:.1f}px)rotate({-turned_deg:.0f}deg)"


def _path(scene: Scene, clock: _Clock) -> list[str]:
    """Return the SVG of the route, the trail of each instant, and the vehicle."""
    to_picture = _Map(scene)
    elements = []
    if scene.route is not None:
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in to_picture(scene.route))
        drawing_style = ""
        if clock.begin_s >= FIT_S:  # the route is taught while the intervals of the fit narrow
            steps = [(0.0, "stroke-dashoffset:1"), (clock.begin_s - 0.3, "stroke-dashoffset:0")]
            drawing_style = f' pathLength="1" stroke-dasharray="1" style="{clock.animate("r", steps)}"'
        elements.append(f'<polyline class="route" points="{points}"{drawing_style}/>')
    elements += _trail(scene, to_picture, clock)
    headings = np.degrees(np.unwrap(scene.vehicle_poses[:, 2]))
    size_px = max(scene.radius_m * to_picture.scale, 5.0)
    lesson_steps = _lesson_steps(scene, clock) if scene.route is not None and clock.begin_s >= FIT_S else []
    steps = [(s, to_picture.pose(eta, deg)) for s, eta, deg in lesson_steps]
    steps += [
        (clock.picture_time_s(t), to_picture.pose(eta, deg))
        for t, eta, deg in zip(scene.t_s, scene.vehicle_poses, headings, strict=True)
    ]
    wheel = f'<rect class="wheel" x="{-size_px / 2.6:.1f}" width="{size_px / 1.3:.1f}" height="{size_px / 3.2:.1f}"'
    if scene.true_poses is not None and scene.estimated_poses is not None:
        heading_deg = np.degrees(np.unwrap(scene.estimated_poses[:, 2]))
        ghost = [(clock.picture_time_s(t), to_picture.pose(eta, deg))
                 for t, eta, deg in zip(scene.t_s, scene.estimated_poses, heading_deg, strict=True)]  # fmt: skip
        style = clock.animate("g", [(s, f"{css};opacity:{int(s > clock.begin_s)}") for s, css in ghost])
        elements.append(f'<g style="{ghost[-1][1]};{style}"><circle class="ghost" r="{size_px:.1f}"/></g>')
    elements.append(
        f'<g style="{steps[-1][1]};{clock.animate("v", steps)}"><circle class="body" r="{size_px:.1f}"/>'
        f'{wheel} y="{-0.95 * size_px:.1f}"/>{wheel} y="{0.64 * size_px:.1f}"/>'
        f'<path class="wheel" d="M{size_px * 0.82:.1f} 0l{-size_px * 0.4:.1f} {-size_px * 0.24:.1f}'
        f'v{size_px * 0.48:.1f}z"/></g>'
    )
    return elements


def _lesson_steps(scene: Scene, clock: _Clock) -> list[tuple[float, np.ndarray, float]]:
    """Return (seconds, pose, heading [°]) along the route while it is taught."""
    assert scene.route is not None
    xy = scene.route[:: max(1, len(scene.route) // 40)]
    displacements = np.diff(xy, axis=0, append=xy[:1])
    heading = np.degrees(np.unwrap(np.arctan2(displacements[:, 1], displacements[:, 0])))
    times_s = np.linspace(0.0, clock.begin_s - 0.3, len(xy))
    first_deg = np.degrees(np.unwrap(scene.vehicle_poses[:, 2]))[0]
    heading += 360.0 * round((first_deg - heading[-1]) / 360.0)  # no turn before the first lap
    return [(float(s), np.append(p, 0.0), float(deg)) for s, p, deg in zip(times_s, xy, heading, strict=True)]


def _trail(scene: Scene, to_picture: _Map, clock: _Clock) -> list[str]:
    """Return the corridor, the estimated path and the true path between instants.

    Each segment stays visible for a lap; the segments of the last lap stay to the end.
    """
    elements = []
    lap_s = clock.laps_s / scene.laps
    steps = "0%{opacity:0}0.6%{opacity:1}%s{opacity:1}%s{opacity:0}100%%{opacity:0}"
    for name, stay_s in (("t", lap_s), ("l", min(lap_s + REST_S, clock.period_s - 0.4))):
        clock.frames[name] = steps.replace("0%{opacity:0}0.6%{", "0%%{opacity:0}0.6%%{") % (
            clock.percentage(stay_s), clock.percentage(stay_s + 0.3))  # fmt: skip
    last_lap_s = scene.t_s[-1] * (scene.laps - 1) / scene.laps - 1e-9
    for k, (t, _end_s) in enumerate(pairwise(scene.t_s)):
        parts = []
        if (
            scene.estimated_poses is not None
            and scene.half_m is not None
            and np.isfinite(scene.half_m[k : k + 2]).all()
        ):
            parts.append(_quad(scene, to_picture, k))
        for poses, kind in ((scene.estimated_poses, "sure"), (scene.true_poses, "true")):
            if poses is not None:
                (x0, y0), (x1, y1) = to_picture(poses[k : k + 2, :2])
                parts.append(f'<path class="{kind}" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>')
        name, attributes = ("l", "") if t >= last_lap_s else ("t", ' class="gone"')
        style = (
            f"animation:{name} {clock.period_s:g}s linear {clock.picture_time_s(t):.2f}s infinite backwards"
        )
        elements.append(f'<g{attributes} style="{style}">{"".join(parts)}</g>')
    return elements


def _quad(scene: Scene, to_picture: _Map, k: int) -> str:
    """Return the corridor between two instants."""
    assert scene.estimated_poses is not None
    assert scene.half_m is not None
    eta, half_width = scene.estimated_poses[k : k + 2], scene.half_m[k : k + 2, None]
    left_normal = half_width * np.stack([-np.sin(eta[:, 2]), np.cos(eta[:, 2])], axis=1)
    corners = to_picture(np.concatenate([eta[:, :2] + left_normal, (eta[:, :2] - left_normal)[::-1]]))
    return '<path class="band" d="M' + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + 'z"/>'


def _readout(scene: Scene, clock: _Clock, y: float) -> list[str]:
    """Return for each lap its number, and the corridor's width and the true position error at its end."""
    elements = []
    for lap in range(1, scene.laps + 1):
        k = round(lap * (len(scene.t_s) - 1) / scene.laps)
        begin_s = clock.picture_time_s(scene.t_s[-1] * (lap - 1) / scene.laps)
        end_s = clock.picture_time_s(scene.t_s[k])
        is_last = lap == scene.laps
        style = clock.show_between(f"n{lap}", begin_s, clock.period_s if is_last else end_s)
        lines = [_("lap {lap} of {laps}", lap=lap, laps=scene.laps) if scene.laps > 1 else _("the drive")]
        if scene.half_m is not None:
            radius = _("lost") if np.isnan(scene.half_m[k]) else f"± {_length(scene.half_m[k])}"
            lines.append(_("cross-track: {width} (95 %)", width=radius))
        if scene.true_poses is not None and scene.estimated_poses is not None:
            error_m = float(np.hypot(*(scene.true_poses[k] - scene.estimated_poses[k])[:2]))
            lines.append(_("true error at the end: {distance}", distance=_length(error_m)))
        texts = "".join(
            f'<text x="{MAP_SIZE_PX + 50}" y="{y + 22 * row:.0f}"{_kind(row)}>{escape(line)}</text>'
            for row, line in enumerate(lines)
        )
        elements.append(f'<g{"" if is_last else _FADING} style="{style}">{texts}</g>')
    return elements


_FADING = ' class="gone"'


def _kind(row: int) -> str:
    return ' class="title"' if row == 0 else ""


def _length(length_m: float) -> str:
    return f"{number(100.0 * length_m):.2g} cm" if length_m < 0.995 else f"{number(length_m):.2g} m"


def _legend(scene: Scene, y: float) -> list[str]:
    """Return a legend line for each drawn element."""
    entries = [("route", _("taught path"), scene.route is not None),
             ("band", _("corridor, 95 %"), scene.half_m is not None),
             ("sure", _("estimated path"), scene.estimated_poses is not None),
             ("true", _("true path"), scene.true_poses is not None)]  # fmt: skip
    elements, x = [], MAP_SIZE_PX + 50
    for k, (kind, label, _visible) in enumerate([entry for entry in entries if entry[2]]):
        text_x, text_y = x + 178 * (k % 2), y + 24 * (k // 2) + 14
        mark = (
            f'<rect class="band" x="{text_x}" y="{text_y - 12}" width="22" height="14"/>'
            if kind == "band"
            else f'<path class="{kind}" d="M{text_x} {text_y - 5}h22"/>'
        )
        elements.append(f'{mark}<text class="soft" x="{text_x + 30}" y="{text_y}">{escape(label)}</text>')
    return elements


def _fit_parts(partial_fits: Sequence[PartialFit], labels: Sequence[str], clock: _Clock) -> list[str]:
    """Return the intervals, which narrow from stage to stage, and the duration and verdict of each stage."""
    x, zero, top = MAP_SIZE_PX + 50, WIDTH_PX - MARGIN - AXIS - 8, 98.0
    step_s = (clock.begin_s - 0.4) / len(partial_fits)
    title, subtitle = _("Learning during a drive"), _("error bars of the fit, 95 %; dotted: the truth")
    elements = [f'<text class="title" x="{x}" y="46">{escape(title)}</text>']
    elements.append(f'<text class="soft" x="{x}" y="66">{escape(subtitle)}</text>')
    bottom = top + ROW * len(labels)
    for tick, label_text in ((-BAR, f"−{100 * BAR:.0f} %"), (0.0, ""), (BAR, f"+{100 * BAR:.0f} %")):
        tick_x = zero + AXIS * tick / BAR
        line = "zero" if tick == 0.0 else "axis"
        elements.append(f'<path class="{line}" d="M{tick_x:.0f} {top - 8:.0f}V{bottom - 10:.0f}"/>')
        elements.append(
            f'<text class="soft" text-anchor="middle" x="{tick_x:.0f}" y="{bottom + 6:.0f}">{label_text}</text>'
        )
    for row, label in enumerate(labels):
        y = top + ROW * row + 6
        css = [_interval(partial_fit, row) for partial_fit in partial_fits]
        steps = [
            (k * step_s + delay_s, style)
            for k, style in enumerate(css)
            for delay_s in (0.35 * (k > 0), step_s)
        ]
        style = clock.animate(f"b{row}", [(0.0, css[0]), *steps[1:], (clock.period_s, css[-1])])
        elements.append(
            f'<text x="{x}" y="{y + 5:.0f}">{escape(label)}</text><g transform="translate({zero:.0f} {y:.0f})">'
            f'<rect class="bar" x="-1" y="-5" width="2" height="10" style="{css[-1]};{style}"/></g>'
        )
    for k, partial_fit in enumerate(partial_fits):
        is_last = k == len(partial_fits) - 1
        style = clock.show_between(f"s{k}", k * step_s, clock.period_s if is_last else (k + 1) * step_s)
        tone = "good" if partial_fit.verdict == "USABLE" else "warn"
        drive = _("{seconds:.0f} s of drive", seconds=partial_fit.seconds)
        elements.append(
            f'<g{"" if is_last else _FADING} style="{style}"><text x="{x}" y="{bottom + 36:.0f}">{escape(drive)}: '
            f'<tspan class="{tone}">{partial_fit.verdict}</tspan></text></g>'
        )
    return elements


def _interval(partial_fit: PartialFit, row: int) -> str:
    """Return the CSS of an interval, clipped at the ends of the axis."""
    error, half_width = partial_fit.relative_error[row], partial_fit.half_width[row]
    if not np.isfinite(error + half_width):
        error, half_width = 0.0, BAR
    low, high = (float(np.clip(error + side * half_width, -BAR, BAR)) * AXIS / BAR for side in (-1.0, 1.0))
    return f"transform:translateX({(low + high) / 2:.1f}px)scaleX({max((high - low) / 2, 1.2):.1f})"
