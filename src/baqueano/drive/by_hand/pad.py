"""Drive by a game pad: find it among the devices of Linux's input layer, and read its stick and buttons.

  x = (value − middle) / half its range,  ahead = −x of Y,  to the left = −x of X                       (1)
  0 if |x| is within the larger of REST and the kernel's flat; beyond it proportional, up to 1          (2)

A pad has a stick (ABS_X, ABS_Y) and at least one button of HOLD, the buttons under the first fingers. It drives only
while a button of HOLD is pressed, so that a pad that falls on the floor does not drive. It also does not drive until
stick and buttons have been released once since it was opened. The reason: the kernel reports 0 for an axis that has not
moved yet, which on many pads is one end of its range. If the kernel had to drop events, the state is read again; until
then the pad does not drive. Unplugging a pad stops the vehicle. The kernel removes a radio pad only seconds after its
link is lost, so use a cable.
"""

import re
import sys
from pathlib import Path

from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.drive.by_hand.evdev import ABS, DROPPED, KEY, REPORT, SYN, Axis, InputDevice, InputEvent, X, Y
from baqueano.errors import UsageError
from baqueano.messages import text
from baqueano.messages.language import translate as _

FOLDER = Path("/dev/input")
# The codes of a game pad (BTN_SOUTH …), and of a pad with numbered buttons (BTN_TRIGGER …)
MARK, STOP = {0x130, 0x120}, {0x131, 0x121}
HOLD = {0x136, 0x137, 0x124, 0x125}
REST = 0.12  # of half its range, because a stick does not return exactly to its middle
GROUP = "sudo usermod -aG input $USER, then log in again"


class Pad:
    """The game pad at `device`: its buttons and the direction of its stick."""

    def __init__(self, device: InputDevice) -> None:
        self._device, self.name, self.gone = device, device.name, False
        self._axes: dict[int, Axis] = {}
        self._down: set[int] = set()
        self._overrun, self._let_go = False, False
        self._ask_anew()
        self._look()

    def read(self) -> list[int]:
        """Return the codes of the buttons pressed since the last call; set `gone` if the pad is unplugged."""
        if self.gone:
            return []
        buttons: list[int] = []
        try:
            for event in self._device.read():
                buttons += self._take(event)
        except OSError:  # ENODEV
            self.gone = True
        self._look()
        return buttons

    @property
    def holds(self) -> bool:
        """Return True if the pad drives: a button of HOLD is pressed, and the pad is ready."""
        return self._let_go and not self._overrun and not self.gone and bool(self._down & HOLD)

    @property
    def hint(self) -> str:
        """Return a hint for the driver in the current language: how to drive by the pad."""
        if self.holds:
            return _("pad drives")
        return (
            _("pad: hold a front button to drive")
            if self._let_go
            else _("pad: release its stick and buttons first")
        )

    def direction(self) -> tuple[float, float]:
        """Return (ahead, to the left), each in [-1, 1]; zeros unless the pad drives.  (1)"""
        return (-self._part(Y), -self._part(X)) if self.holds else (0.0, 0.0)

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def _look(self) -> None:
        at_rest = not any(map(self._part, (X, Y))) and not self._down & HOLD
        self._let_go = self._let_go or (at_rest and not self._overrun)

    def _take(self, event: InputEvent) -> list[int]:
        """Process an event, and return the codes of the buttons newly pressed."""
        kind, code, value = event
        if kind == SYN and code == DROPPED:
            self._overrun = True
        elif self._overrun:
            return self._ask_anew() if kind == SYN and code == REPORT else []
        elif kind == ABS and code in self._axes:
            self._axes[code] = self._axes[code]._replace(value=value)
        elif kind == KEY and value == 1 and code not in self._down:  # known already if it was read
            self._down.add(code)
            return [code]
        elif kind == KEY and value == 0:
            self._down.discard(code)
        return []

    def _ask_anew(self) -> list[int]:
        """Read the whole state again, and return the codes of the buttons pressed in the meantime."""
        before = self._down
        self._axes, self._down = {code: self._device.axis(code) for code in (X, Y)}, self._device.down()
        self._overrun = False
        return sorted(self._down - before)

    def _part(self, code: int) -> float:
        """Return the deflection of an axis in [-1, 1].  (1), (2)"""
        axis = self._axes[code]
        half = max(0.5 * (axis.high - axis.low), 0.5)
        x = (axis.value - 0.5 * (axis.high + axis.low)) / half
        rest = min(max(REST, axis.flat / half), 0.9)
        beyond = min(max(0.0, abs(x) - rest) / (1.0 - rest), 1.0)
        return beyond if x > 0.0 else -beyond


def find(named: Path | None = None, folder: Path = FOLDER) -> Pad:
    """Return the only pad of this computer, or the pad at the path `named`.

    Raise UsageError without a pad, if there are several, or if the pad may not be read. The message lists the devices
    that were examined.
    """
    if sys.platform != "linux":
        raise UsageError(fault("pad.not-linux"))
    if named is not None:
        return _pad_at(named)
    pads, descriptions, closed_names = [], [], []
    for path in sorted(folder.glob("event*"), key=lambda p: int(re.sub(r"\D", "", p.name) or 0)):
        try:
            device = InputDevice(path)
        except PermissionError:
            closed_names.append(path.name)
            continue
        except OSError as error:
            descriptions.append(f"{path.name} ({error.strerror or error})")
            continue
        if lack := lacking(device):
            descriptions.append(f'{path.name} "{device.name}" ({text(note(f"pad.no-{lack}"))})')
            device.close()
        else:
            pads.append((path, device))
    if len(pads) == 1:
        return Pad(pads[0][1])
    for _name, device in pads:
        device.close()
    if pads:
        several = ", ".join(f'{path} "{device.name}"' for path, device in pads)
        raise UsageError(fault("pad.several", count=len(pads), several=several, first=pads[0][0]))
    raise UsageError(_none(folder, descriptions, closed_names))


def lacking(device: InputDevice) -> str:
    """Return the part that `device` lacks to be a pad: "stick", "front-buttons", or "" for a pad."""
    if not {X, Y} <= device.axes:
        return "stick"
    return "" if device.keys & HOLD else "front-buttons"


def _none(folder: Path, descriptions: list[str], closed_names: list[str]) -> Diagnostic:
    if not closed_names:
        return fault("pad.not-among" if descriptions else "pad.none", folder=folder, looked=descriptions)
    return fault("pad.closed", GROUP, folder=folder, looked=descriptions, closed=closed_names)


def _pad_at(path: Path) -> Pad:
    try:
        device = InputDevice(path)
    except PermissionError as error:
        raise UsageError(fault("pad.may-not-read", f"{GROUP}", path=path)) from error
    except OSError as error:
        raise UsageError(fault("pad.not-evdev", path=path, error=error.strerror or error)) from error
    if lack := lacking(device):
        device.close()
        raise UsageError(fault("pad.lacks", path=path, name=device.name, lack=note(f"pad.no-{lack}")))
    return Pad(device)
