"""Drive with a game pad: find it among the devices of Linux's input layer, and read its stick and buttons.

  x = (value − middle) / half the range,  forward = −x of Y,  left = −x of X                            (1)
  0 if |x| is within the larger of DEAD_BAND and the kernel's flat; beyond it proportional, up to 1          (2)

A pad has a stick (ABS_X, ABS_Y) and at least one button of HOLD_BUTTONS, the buttons under the index fingers. It
commands the vehicle only while such a button is pressed, so that a pad that falls down commands nothing. Stick and
buttons must also have been released once since the pad was opened. The reason: the kernel reports 0 for an axis that
has not moved yet, which on many pads is one end of its range. If the kernel had to drop events, the state is read
again; until then the command is zero. Unplugging a pad stops the vehicle. The kernel removes a wireless pad only
seconds after its link is lost, so use a cable.
"""

import re
import sys
from pathlib import Path

from baqueano.diagnostics import Diagnostic, fault, note
from baqueano.drive.manual.evdev import ABS, DROPPED, KEY, REPORT, SYN, Axis, InputDevice, InputEvent, X, Y
from baqueano.errors import UsageError
from baqueano.messages import text
from baqueano.messages.language import translate as _

DEVICE_FOLDER = Path("/dev/input")
# The codes of a game pad (BTN_SOUTH …), and of a pad with numbered buttons (BTN_TRIGGER …)
MARK, STOP = {0x130, 0x120}, {0x131, 0x121}
HOLD_BUTTONS = {0x136, 0x137, 0x124, 0x125}
DEAD_BAND = 0.12  # fraction of half the range, because a stick does not return exactly to its middle
JOIN_INPUT_GROUP = "sudo usermod -aG input $USER, then log in again"


class Pad:
    """The game pad at `device`: its buttons and the direction of its stick."""

    def __init__(self, device: InputDevice) -> None:
        self._device, self.name, self.is_disconnected = device, device.name, False
        self._axes: dict[int, Axis] = {}
        self._pressed_codes: set[int] = set()
        self._overrun, self._has_been_released = False, False
        self._resynchronise()
        self._update_released()

    def read(self) -> list[int]:
        """Return the codes of the buttons pressed since the last call; set `is_disconnected` for an unplugged pad."""
        if self.is_disconnected:
            return []
        buttons: list[int] = []
        try:
            for event in self._device.read():
                buttons += self._process(event)
        except OSError:  # ENODEV
            self.is_disconnected = True
        self._update_released()
        return buttons

    @property
    def is_held(self) -> bool:
        """Return True if the pad commands the vehicle: a button of HOLD_BUTTONS is pressed, and the pad is ready."""
        return (
            self._has_been_released
            and not self._overrun
            and not self.is_disconnected
            and bool(self._pressed_codes & HOLD_BUTTONS)
        )

    @property
    def hint(self) -> str:
        """Return a hint for the driver in the current language: how to drive with the pad."""
        if self.is_held:
            return _("pad drives")
        if self._has_been_released:
            return _("pad: hold a front button to drive")
        return _("pad: release its stick and buttons first")

    def direction(self) -> tuple[float, float]:
        """Return (forward, left), each in [-1, 1]. Both are 0 if `is_held` is False.  (1)"""
        return (-self._deflection(Y), -self._deflection(X)) if self.is_held else (0.0, 0.0)

    def close(self) -> None:
        """Close the device."""
        self._device.close()

    def _update_released(self) -> None:
        at_rest = not any(map(self._deflection, (X, Y))) and not self._pressed_codes & HOLD_BUTTONS
        self._has_been_released = self._has_been_released or (at_rest and not self._overrun)

    def _process(self, event: InputEvent) -> list[int]:
        """Process an event, and return the codes of the buttons newly pressed."""
        event_type, code, value = event
        if event_type == SYN and code == DROPPED:
            self._overrun = True
        elif self._overrun:
            return self._resynchronise() if event_type == SYN and code == REPORT else []
        elif event_type == ABS and code in self._axes:
            self._axes[code] = self._axes[code]._replace(value=value)
        elif event_type == KEY and value == 1 and code not in self._pressed_codes:  # known if it was read
            self._pressed_codes.add(code)
            return [code]
        elif event_type == KEY and value == 0:
            self._pressed_codes.discard(code)
        return []

    def _resynchronise(self) -> list[int]:
        """Read the whole state again, and return the codes of the buttons pressed in the meantime."""
        previous_codes = self._pressed_codes
        self._axes = {code: self._device.axis(code) for code in (X, Y)}
        self._pressed_codes = self._device.pressed_codes()
        self._overrun = False
        return sorted(self._pressed_codes - previous_codes)

    def _deflection(self, code: int) -> float:
        """Return the deflection of an axis in [-1, 1].  (1), (2)"""
        axis = self._axes[code]
        half_range = max(0.5 * (axis.high - axis.low), 0.5)
        x = (axis.value - 0.5 * (axis.high + axis.low)) / half_range
        dead_band = min(max(DEAD_BAND, axis.rest_width / half_range), 0.9)
        deflection = min(max(0.0, abs(x) - dead_band) / (1.0 - dead_band), 1.0)
        return deflection if x > 0.0 else -deflection


def find_pad(pad_path: Path | None = None, folder: Path = DEVICE_FOLDER) -> Pad:
    """Return the only pad of this computer, or the pad at the path `pad_path`.

    Raise UsageError on another system than Linux, without a pad, or with several pads. Raise UsageError for a device
    that is not a pad, or that this user is not allowed to read. The message lists the devices that were examined.
    """
    if sys.platform != "linux":
        raise UsageError.of("pad.not-linux")
    if pad_path is not None:
        return _open_pad(pad_path)
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
        if missing := missing_part(device):
            descriptions.append(f'{path.name} "{device.name}" ({text(note(f"pad.no-{missing}"))})')
            device.close()
        else:
            pads.append((path, device))
    if len(pads) == 1:
        return Pad(pads[0][1])
    for _name, device in pads:
        device.close()
    if pads:
        pad_names = ", ".join(f'{path} "{device.name}"' for path, device in pads)
        raise UsageError.of("pad.several", count=len(pads), names=pad_names, first=pads[0][0])
    raise UsageError(_no_pad_reason(folder, descriptions, closed_names))


def missing_part(device: InputDevice) -> str:
    """Return the part that `device` lacks to be a pad: "stick", "front-buttons", or "" for a pad."""
    if not {X, Y} <= device.axes:
        return "stick"
    return "" if device.keys & HOLD_BUTTONS else "front-buttons"


def _no_pad_reason(folder: Path, descriptions: list[str], closed_names: list[str]) -> Diagnostic:
    if not closed_names:
        return fault("pad.not-among" if descriptions else "pad.none", folder=folder, devices=descriptions)
    return fault(
        "pad.closed", JOIN_INPUT_GROUP, folder=folder, devices=descriptions, locked_devices=closed_names
    )


def _open_pad(path: Path) -> Pad:
    try:
        device = InputDevice(path)
    except PermissionError as error:
        raise UsageError.of("pad.may-not-read", f"{JOIN_INPUT_GROUP}", path=path) from error
    except OSError as error:
        raise UsageError.of("pad.not-evdev", path=path, error=error.strerror or error) from error
    if missing := missing_part(device):
        device.close()
        raise UsageError.of("pad.lacks", path=path, name=device.name, reason=note(f"pad.no-{missing}"))
    return Pad(device)
