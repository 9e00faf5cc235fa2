"""Draw a scene and the stages of a fit as SVG, animated by CSS keyframes, so that the SVG also moves in an <img>.

A reader who prefers no motion sees the last instant, which is the state of each element without its keyframes.
"""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import pairwise

import numpy as np

from baqueano.messages.language import number
from baqueano.messages.language import translate as _
from baqueano.report.animation.bars import Stage
from baqueano.report.animation.scene import Scene

WIDE, HIGH, LEFT, MARGIN = 860, 430, 440, 26  # of the picture; of the part with the path
FIT_S, LAP_S, LONGEST_S, REST_S = 4.0, 3.4, 11.0, 2.6  # the fit, a lap, all laps, the end
# the largest error shown, in parts of the truth; half an axis and a row in px
BAR, AXIS, ROW = 0.2, 96.0, 29.0
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


def animation(scene: Scene, stages: Sequence[Stage] = (), labels: Sequence[str] = ()) -> str:
    """Return the SVG of a scene, with the stages of a fit beside it; `labels` name its parameters."""
    clock = _Clock(scene, bool(stages))
    parts = [
        *_path(scene, clock),
        *_readout(scene, clock, 312 if stages else 120),
        *_legend(scene, 374 if stages else 220),
    ]
    if stages:
        parts += _fit_parts(stages, labels, clock)
    keyframes = "".join(f"@keyframes {name}{{{steps}}}" for name, steps in clock.frames.items())
    title = _("A taught path, driven again; shaded: where the vehicle may be, 95 %")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {HIGH}" role="img">'
        f"<title>{escape(title)}</title><style>{STYLE}{keyframes}</style>"
        f'<rect width="{WIDE}" height="{HIGH}" rx="12" fill="var(--paper)"/>{"".join(parts)}</svg>\n'
    )


class _Clock:
    """The time axis of the animation: fit and teaching, the laps, a rest; then it repeats."""

    def __init__(self, scene: Scene, teaches: bool) -> None:
        self.begin_s = FIT_S if teaches else 0.6
        self.laps_s = min(LAP_S * scene.laps, LONGEST_S)
        self.whole_s = self.begin_s + self.laps_s + REST_S
        self.frames: dict[str, str] = {}
        self._end_s = float(scene.t_s[-1])

    def at(self, t_s: float) -> float:
        """Return the time in the animation [s] at the instant `t_s` of the run."""
        return self.begin_s + self.laps_s * t_s / self._end_s

    def part(self, picture_s: float) -> str:
        return f"{100.0 * min(picture_s / self.whole_s, 1.0):.2f}%"

    def moves(self, name: str, steps: Iterable[tuple[float, str]]) -> str:
        """Add keyframes (seconds, CSS), and return the style that plays them."""
        self.frames[name] = "".join(f"{self.part(s)}{{{css}}}" for s, css in steps)
        return f"animation:{name} {self.whole_s:g}s linear infinite"

    def visible(self, name: str, from_s: float, to_s: float, fade_s: float = 0.15) -> str:
        """Return the style of an element that appears at `from_s` and disappears at `to_s`.
        An element that lasts to the end stays visible.
        """
        end = self.whole_s if to_s >= self.whole_s else to_s
        steps = [(0.0, "opacity:0"), (from_s, "opacity:0"), (min(from_s + fade_s, end), "opacity:1")]
        steps += [(end, "opacity:1")] if end >= self.whole_s else [(end, "opacity:1"), (end + fade_s, "opacity:0"),
                                                                   (self.whole_s, "opacity:0")]  # fmt: skip
        return self.moves(name, steps)


class _Map:
    """The conversion from metres to the picture: x to the right, y up, the same scale for both."""

    def __init__(self, scene: Scene) -> None:
        poses_list = [
            poses[:, :2] for poses in (scene.estimated, scene.true, scene.route) if poses is not None
        ]
        xy = np.concatenate(poses_list)
        widest = 0.0 if scene.half_m is None else float(np.nanmax(scene.half_m, initial=0.0))
        room = max(scene.radius_m, widest) * 1.15
        low, high = xy.min(axis=0) - room, xy.max(axis=0) + room
        self.scale = float(
            min((LEFT - MARGIN) / (high[0] - low[0]), (HIGH - 2 * MARGIN) / (high[1] - low[1]))
        )
        self._middle = (low + high) / 2

    def __call__(self, xy: np.ndarray) -> np.ndarray:
        """Return the position (…, 2) in the picture [px]."""
        centre = np.array([(LEFT + MARGIN) / 2 + 6, HIGH / 2])
        return centre + self.scale * (xy - self._middle) * np.array([1.0, -1.0])

    def pose(self, eta: np.ndarray, turned_deg: float) -> str:
        """Return the CSS transform of a body at this pose, with the unwrapped heading `turned_deg` [°]."""
        x, y = self(eta[:2])
        return f"transform:translate({x:.1f}px,{y:.1f}px)rotate({-turned_deg:.0f}deg)"


def _path(scene: Scene, clock: _Clock) -> list[str]:
    """Return the SVG of the route, the trail of each instant, and the vehicle."""
    to = _Map(scene)
    out = []
    if scene.route is not None:
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in to(scene.route))
        drawing_style = ""
        if clock.begin_s >= FIT_S:  # it is taught while the fit narrows
            steps = [(0.0, "stroke-dashoffset:1"), (clock.begin_s - 0.3, "stroke-dashoffset:0")]
            drawing_style = f' pathLength="1" stroke-dasharray="1" style="{clock.moves("r", steps)}"'
        out.append(f'<polyline class="route" points="{points}"{drawing_style}/>')
    out += _trail(scene, to, clock)
    headings = np.degrees(np.unwrap(scene.vehicle_poses[:, 2]))
    size = max(scene.radius_m * to.scale, 5.0)
    lesson_steps = _lesson_steps(scene, clock) if scene.route is not None and clock.begin_s >= FIT_S else []
    steps = [(s, to.pose(eta, deg)) for s, eta, deg in lesson_steps]
    steps += [
        (clock.at(t), to.pose(eta, deg))
        for t, eta, deg in zip(scene.t_s, scene.vehicle_poses, headings, strict=True)
    ]
    wheel = f'<rect class="wheel" x="{-size / 2.6:.1f}" width="{size / 1.3:.1f}" height="{size / 3.2:.1f}"'
    if scene.true is not None and scene.estimated is not None:
        heading_deg = np.degrees(np.unwrap(scene.estimated[:, 2]))
        ghost = [(clock.at(t), to.pose(eta, deg))
                 for t, eta, deg in zip(scene.t_s, scene.estimated, heading_deg, strict=True)]  # fmt: skip
        style = clock.moves("g", [(s, f"{css};opacity:{int(s > clock.begin_s)}") for s, css in ghost])
        out.append(f'<g style="{ghost[-1][1]};{style}"><circle class="ghost" r="{size:.1f}"/></g>')
    out.append(
        f'<g style="{steps[-1][1]};{clock.moves("v", steps)}"><circle class="body" r="{size:.1f}"/>'
        f'{wheel} y="{-0.95 * size:.1f}"/>{wheel} y="{0.64 * size:.1f}"/>'
        f'<path class="wheel" d="M{size * 0.82:.1f} 0l{-size * 0.4:.1f} {-size * 0.24:.1f}v{size * 0.48:.1f}z"/></g>'
    )
    return out


def _lesson_steps(scene: Scene, clock: _Clock) -> list[tuple[float, np.ndarray, float]]:
    """Return (seconds, pose, heading [°]) along the route while it is taught."""
    assert scene.route is not None
    xy = scene.route[:: max(1, len(scene.route) // 40)]
    ahead = np.diff(xy, axis=0, append=xy[:1])
    heading = np.degrees(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])))
    when = np.linspace(0.0, clock.begin_s - 0.3, len(xy))
    first = np.degrees(np.unwrap(scene.vehicle_poses[:, 2]))[0]
    heading += 360.0 * round((first - heading[-1]) / 360.0)  # so that it does not turn before the first lap
    return [(float(s), np.append(p, 0.0), float(deg)) for s, p, deg in zip(when, xy, heading, strict=True)]


def _trail(scene: Scene, to: _Map, clock: _Clock) -> list[str]:
    """Return the corridor, the estimated path and the true path between instants.

    Each segment stays visible for a lap; the segments of the last lap stay to the end.
    """
    out = []
    a_lap = clock.laps_s / scene.laps
    steps = "0%{opacity:0}0.6%{opacity:1}%s{opacity:1}%s{opacity:0}100%%{opacity:0}"
    for name, stay_s in (("t", a_lap), ("l", min(a_lap + REST_S, clock.whole_s - 0.4))):
        clock.frames[name] = steps.replace("0%{opacity:0}0.6%{", "0%%{opacity:0}0.6%%{") % (
            clock.part(stay_s), clock.part(stay_s + 0.3))  # fmt: skip
    last = scene.t_s[-1] * (scene.laps - 1) / scene.laps - 1e-9
    for k, (t, _until) in enumerate(pairwise(scene.t_s)):
        parts = []
        if (
            scene.estimated is not None
            and scene.half_m is not None
            and np.isfinite(scene.half_m[k : k + 2]).all()
        ):
            parts.append(_quad(scene, to, k))
        for poses, kind in ((scene.estimated, "sure"), (scene.true, "true")):
            if poses is not None:
                (x0, y0), (x1, y1) = to(poses[k : k + 2, :2])
                parts.append(f'<path class="{kind}" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>')
        name, rest = ("l", "") if t >= last else ("t", ' class="gone"')
        style = f"animation:{name} {clock.whole_s:g}s linear {clock.at(t):.2f}s infinite backwards"
        out.append(f'<g{rest} style="{style}">{"".join(parts)}</g>')
    return out


def _quad(scene: Scene, to: _Map, k: int) -> str:
    """Return the corridor between two instants."""
    assert scene.estimated is not None
    assert scene.half_m is not None
    eta, half = scene.estimated[k : k + 2], scene.half_m[k : k + 2, None]
    to_left = half * np.stack([-np.sin(eta[:, 2]), np.cos(eta[:, 2])], axis=1)
    corners = to(np.concatenate([eta[:, :2] + to_left, (eta[:, :2] - to_left)[::-1]]))
    return '<path class="band" d="M' + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + 'z"/>'


def _readout(scene: Scene, clock: _Clock, y: float) -> list[str]:
    """Return for each lap its number, and the corridor's width and the true position error at its end."""
    out = []
    for lap in range(1, scene.laps + 1):
        k = round(lap * (len(scene.t_s) - 1) / scene.laps)
        begin, end = clock.at(scene.t_s[-1] * (lap - 1) / scene.laps), clock.at(scene.t_s[k])
        last = lap == scene.laps
        style = clock.visible(f"n{lap}", begin, clock.whole_s if last else end)
        lines = [_("lap {lap} of {laps}", lap=lap, laps=scene.laps) if scene.laps > 1 else _("the drive")]
        if scene.half_m is not None:
            radius = _("lost") if np.isnan(scene.half_m[k]) else f"± {_length(scene.half_m[k])}"
            lines.append(_("cross-track: {width} (95 %)", width=radius))
        if scene.true is not None and scene.estimated is not None:
            off = float(np.hypot(*(scene.true[k] - scene.estimated[k])[:2]))
            lines.append(_("true error at the end: {distance}", distance=_length(off)))
        texts = "".join(
            f'<text x="{LEFT + 50}" y="{y + 22 * row:.0f}"{_kind(row)}>{escape(line)}</text>'
            for row, line in enumerate(lines)
        )
        out.append(f'<g{"" if last else _GONE} style="{style}">{texts}</g>')
    return out


_GONE = ' class="gone"'


def _kind(row: int) -> str:
    return ' class="title"' if row == 0 else ""


def _length(length_m: float) -> str:
    return f"{number(100.0 * length_m):.2g} cm" if length_m < 0.995 else f"{number(length_m):.2g} m"


def _legend(scene: Scene, y: float) -> list[str]:
    """Return a legend line for each drawn element."""
    entries = [("route", _("taught path"), scene.route is not None),
             ("band", _("corridor, 95 %"), scene.half_m is not None),
             ("sure", _("estimated path"), scene.estimated is not None),
             ("true", _("true path"), scene.true is not None)]  # fmt: skip
    out, x = [], LEFT + 50
    for k, (kind, label, _visible) in enumerate([entry for entry in entries if entry[2]]):
        at_x, at_y = x + 160 * (k % 2), y + 24 * (k // 2) + 14
        mark = (
            f'<rect class="band" x="{at_x}" y="{at_y - 12}" width="22" height="14"/>'
            if kind == "band"
            else f'<path class="{kind}" d="M{at_x} {at_y - 5}h22"/>'
        )
        out.append(f'{mark}<text class="soft" x="{at_x + 30}" y="{at_y}">{escape(label)}</text>')
    return out


def _fit_parts(stages: Sequence[Stage], labels: Sequence[str], clock: _Clock) -> list[str]:
    """Return the intervals, which narrow from stage to stage, and the duration and verdict of each stage."""
    x, zero, top = LEFT + 50, WIDE - MARGIN - AXIS - 24, 98.0
    each_s = (clock.begin_s - 0.4) / len(stages)
    title, below = _("Learning during a drive"), _("error bars of the fit, 95 %; dotted: the truth")
    out = [f'<text class="title" x="{x}" y="46">{escape(title)}</text>']
    out.append(f'<text class="soft" x="{x}" y="66">{escape(below)}</text>')
    low = top + ROW * len(labels)
    for part, word in ((-BAR, f"−{100 * BAR:.0f} %"), (0.0, ""), (BAR, f"+{100 * BAR:.0f} %")):
        at = zero + AXIS * part / BAR
        line = "zero" if part == 0.0 else "axis"
        out.append(f'<path class="{line}" d="M{at:.0f} {top - 8:.0f}V{low - 10:.0f}"/>')
        out.append(f'<text class="soft" text-anchor="middle" x="{at:.0f}" y="{low + 6:.0f}">{word}</text>')
    for row, label in enumerate(labels):
        y = top + ROW * row + 6
        css = [_interval(stage, row) for stage in stages]
        steps = [
            (k * each_s + late, style) for k, style in enumerate(css) for late in (0.35 * (k > 0), each_s)
        ]
        style = clock.moves(f"b{row}", [(0.0, css[0]), *steps[1:], (clock.whole_s, css[-1])])
        out.append(
            f'<text x="{x}" y="{y + 5:.0f}">{escape(label)}</text><g transform="translate({zero:.0f} {y:.0f})">'
            f'<rect class="bar" x="-1" y="-5" width="2" height="10" style="{css[-1]};{style}"/></g>'
        )
    for k, stage in enumerate(stages):
        last = k == len(stages) - 1
        style = clock.visible(f"s{k}", k * each_s, clock.whole_s if last else (k + 1) * each_s)
        tone = "good" if stage.verdict == "USABLE" else "warn"
        drive = _("{seconds:.0f} s of drive", seconds=stage.seconds)
        out.append(
            f'<g{"" if last else _GONE} style="{style}"><text x="{x}" y="{low + 36:.0f}">{escape(drive)}: '
            f'<tspan class="{tone}">{stage.verdict}</tspan></text></g>'
        )
    return out


def _interval(stage: Stage, row: int) -> str:
    """Return the CSS of an interval, clipped at the ends of the axis."""
    off, half = stage.off[row], stage.half[row]
    if not np.isfinite(off + half):
        off, half = 0.0, BAR
    low, high = (float(np.clip(off + side * half, -BAR, BAR)) * AXIS / BAR for side in (-1.0, 1.0))
    return f"transform:translateX({(low + high) / 2:.1f}px)scaleX({max((high - low) / 2, 1.2):.1f})"
