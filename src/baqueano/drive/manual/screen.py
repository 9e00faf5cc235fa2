"""Draw the display of a driver: a block of lines, drawn again in the same place.

  the first time     the block, line by line
  again              cursor up to the first line, each line overwritten and its rest erased, in one write    (1)

A terminal with synchronised updates shows (1) at once. On other terminals each line replaces a similar line, so the
screen is never empty in between. The characters are ASCII, because a serial console supports only ASCII.
"""

from dataclasses import dataclass, field
from math import degrees, isfinite, nan

import numpy as np

from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.printable import one_line

_ACCENTS = str.maketrans("áéíóúüñÁÉÍÓÚÑ", "aeiouunAEIOUN", "¿¡")  # of Spanish
BAR_LETTERS = 20  # characters of the bar: half of them for a duty of 1
HOLD, UNHOLD = "\x1b[?2026h", "\x1b[?2026l"


@dataclass
class Status:
    """The content of the display."""

    name: str
    t_s: float = 0.0
    state: str = ""
    reason: str = ""
    driver_command: np.ndarray = field(default_factory=lambda: np.zeros(3))
    motor_command: np.ndarray = field(default_factory=lambda: np.zeros(3))
    names: tuple[str, ...] = ("u_x", "u_y", "u_psi")
    limit: np.ndarray = field(default_factory=lambda: np.ones(3))
    speed_m_s: float = nan
    yaw_rate_rad_s: float = nan
    battery_v: float = nan
    link_ms: float = nan  # round trip to the vehicle
    terminal_ms: float = nan  # round trip to the terminal
    command_share: float = 0.5
    delay_factor: float = 1.0  # share of the speed that the round trip allows
    key_mode: str = ""  # how keys are held
    hold_command: float | None = None  # turn command of the heading hold; NaN: not active now, None: not used
    mark_count: int = 0
    pad: str = ""
    sensor_text: str = ""  # the degraded sensors
    standstill_reason: str = ""  # why the vehicle stays at rest although motion is commanded
    message: str = ""  # the last message to the driver


def status_lines(s: Status, columns: int = 80) -> list[str]:
    """Return the lines of the block, each with at most `columns` − 1 characters."""
    link = "  ".join(
        f"{_(name)} {decimal_text(value, 0)} ms"
        for name, value in ((N_("vehicle"), s.link_ms), (N_("terminal"), s.terminal_ms))
    )
    active_axes = [k for k in range(len(s.limit)) if s.limit[k] > 0.0]
    rows = [
        f"== baqueano drive: {s.name} " + "=" * columns,
        f"   {s.state or '...':10} {number(s.t_s):7.1f} s    "
        + _(
            "battery {battery_v} V    marks {marks}",
            battery_v=decimal_text(s.battery_v, 2),
            marks=s.mark_count,
        ),
        "   "
        + _(
            "speed {speed:>6} m/s    yaw rate {yaw_rate:>6} rad/s ({degrees:>4} deg/s)",
            speed=decimal_text(s.speed_m_s, 2),
            yaw_rate=decimal_text(s.yaw_rate_rad_s, 2),
            degrees=decimal_text(degrees(s.yaw_rate_rad_s), 0),
        ),
        *(
            f"   {s.names[k]:6} {_duty_bar(s.motor_command[k])} {number(float(s.motor_command[k])):+5.2f}   "
            + _("driver {expected:+5.2f}", expected=float(s.driver_command[k]))
            + (f"   {_hold_text(s.hold_command)}" if k == len(s.limit) - 1 else "")
            for k in active_axes
        ),
        "   "
        + _("round trip: {link}", link=link)
        + (
            ": " + _("slowed to {percent:.0f} %", percent=100 * s.delay_factor)
            if s.delay_factor < 1.0
            else ""
        ),
        "   "
        + _(
            "a key gives up to {percent:.0f} % of the limit;  keys: {way}",
            percent=100 * s.command_share,
            way=_(s.key_mode),
        ),
        *([f"   {s.pad}"] if s.pad else []),
        "   " + _("arrows or w a s d, 7 9 1 3 arcs | x zero | + - speed | l latch"),
        "   " + _("SPACE stops the vehicle | m on the mark now | q ends the drive"),
        f"   {s.reason or s.sensor_text or s.standstill_reason or s.message}",
    ]
    return [one_line(row)[: columns - 1] for row in rows]


def decimal_text(value: float, digits: int) -> str:
    """Return a number as text with this many decimals, "-" if it is not finite."""
    return f"{number(value):.{digits}f}" if value is not None and isfinite(value) else "-"


def _hold_text(u: float | None) -> str:
    if u is None:
        return _("heading not corrected")
    return _("heading hold {u:+.2f}", u=u) if isfinite(u) else _("heading free")


def _duty_bar(duty: float) -> str:
    """Return a duty in [-1, 1] as a bar that begins in the middle."""
    half_width = BAR_LETTERS // 2
    n = min(half_width, round(abs(duty) * half_width)) if isfinite(duty) else 0
    left_part, right_part = ("#" * n, "") if duty < 0.0 else ("", "#" * n)
    return f"[{left_part:.>{half_width}}|{right_part:.<{half_width}}]"


class Screen:
    """A screen that draws each block over the previous one."""

    def __init__(self) -> None:
        self._height = 0

    def frame(self, block: list[str], height: int = 24) -> bytes:
        """Return the bytes that draw this block, or only its last lines if the block is higher than the screen."""
        block = block[-max(1, height - 1) :]
        cursor_up = f"\r\x1b[{self._height}A" if self._height else "\r"
        blank_count = max(0, self._height - len(block))
        text = "".join(f"{row}\x1b[K\r\n" for row in block) + "\x1b[K\r\n" * blank_count
        self._height = len(block) + blank_count
        return (HOLD + cursor_up + text + UNHOLD).translate(_ACCENTS).encode("ascii", errors="replace")
