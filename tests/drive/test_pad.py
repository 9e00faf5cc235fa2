"""A game pad is decoded from the bytes of the Linux kernel."""

import errno
import sys

import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive.manual import pad as pads
from baqueano.drive.manual.evdev import EVENT_LAYOUTS, InputDevice, InputEvent, ioctl_code
from baqueano.drive.manual.pad import DEAD_BAND, Pad, find_pad
from baqueano.errors import UsageError
from tests.codes import refused
from tests.drive.test_cockpit import Terminal, cockpit
from tests.emulated.pad_kernel import ABS, KEY, KernelDevice, bare_pad, connect, keyboard, pad, touchpad

LEFT_FRONT, SOUTH, EAST = 0x136, 0x130, 0x131
AHEAD, LEFT = (ABS, 1, -32768), (ABS, 0, -32768)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux's input layer")


@pytest.fixture
def plug(tmp_path, monkeypatch):
    """Return `plugged(device, …)`, which gives the folder in which the devices are event0, event1, …"""

    def plug(*devices):
        connect(monkeypatch, {tmp_path / f"event{k}": device for k, device in enumerate(devices)})
        return tmp_path

    return plug


def open_pad(folder, name="event0"):
    return Pad(InputDevice(folder / name))


def test_ioctl_numbers_equal_the_constants_of_the_kernel_headers():
    assert ioctl_code(0x40, 24) == 0x80184540  # EVIOCGABS(0)
    assert ioctl_code(0x06, 256) == 0x81004506  # EVIOCGNAME(256)
    assert ioctl_code(0x21, 96) == 0x80604521  # EVIOCGBIT(EV_KEY, 96)


@pytest.mark.parametrize(("long_bytes", "size"), [(4, 16), (8, 24)])
def test_events_are_decoded_with_32_bit_and_64_bit_layouts(plug, long_bytes, size):
    assert EVENT_LAYOUTS[long_bytes].size == size
    kernel = pad(long_bytes=long_bytes)
    device = InputDevice(plug(kernel) / "event0", long_bytes)
    kernel.change(AHEAD, (KEY, SOUTH, 1))
    assert device.read() == [InputEvent(*AHEAD), InputEvent(KEY, SOUTH, 1), InputEvent(0, 0, 0)]
    assert device.read() == []


def test_a_game_pad_drives_only_with_a_front_button_pressed(plug):
    kernel = pad()
    game_pad = open_pad(plug(kernel))
    kernel.change(AHEAD, (ABS, 0, 32767))
    assert game_pad.read() == []
    assert game_pad.direction() == (0.0, 0.0)
    kernel.change((KEY, LEFT_FRONT, 1))
    assert game_pad.read() == [LEFT_FRONT]
    assert game_pad.direction() == (1.0, -1.0)
    assert game_pad.hint == "pad drives"
    kernel.change((KEY, LEFT_FRONT, 0))
    game_pad.read()
    assert game_pad.direction() == (0.0, 0.0)


@pytest.mark.parametrize(
    ("low", "high", "flat", "value", "part"),
    [
        (-32768, 32767, 128, -32768, 1.0),
        # a flat below DEAD_BAND: no stick is that good
        (-32768, 32767, 128, round(-32767 * DEAD_BAND * 0.9), 0.0),
        (0, 255, 15, 128, 0.0),
        (0, 255, 15, 0, 1.0),
        (0, 1023, 0, 512 - 256, 0.433),
        (-100, 100, 50, -50, 0.0),
        (-100, 100, 50, -75, 0.5),
        (-100, 100, 50, 100, -1.0),
    ],
)
def test_axis_ranges_and_rest_zones_are_read_from_the_kernel(plug, low, high, flat, value, part):
    middle = (low + high) // 2
    kernel = pad(axes={code: [middle, low, high, 0, flat, 0] for code in (0, 1)})
    game_pad = open_pad(plug(kernel))
    kernel.change((KEY, LEFT_FRONT, 1), (ABS, 1, value))
    game_pad.read()
    assert game_pad.direction() == pytest.approx((part, 0.0), abs=2e-3)


def test_after_lost_events_the_pad_commands_zero_until_resynchronised(plug):
    kernel = pad()
    game_pad = open_pad(plug(kernel))
    kernel.change(AHEAD, (KEY, LEFT_FRONT, 1))
    game_pad.read()
    assert game_pad.direction()[0] == 1.0
    for k in range(40):  # more events than the kernel stores
        kernel.change((ABS, 0, 100 * k))
    kernel.change((ABS, 1, 0), (KEY, EAST, 1))
    data, kernel.waiting = kernel.waiting, kernel.waiting[:1]
    assert data[0] == (0, 3, 0), "the kernel sends SYN_DROPPED"
    game_pad.read()
    assert not game_pad.is_held
    kernel.waiting = data[1:]
    assert game_pad.read() == [EAST], "the stop was pressed during the lost events"
    assert game_pad.is_held
    assert game_pad.direction() == (0.0, 0.0)


def test_a_front_button_released_during_lost_events_is_released(plug):
    kernel = pad()
    game_pad = open_pad(plug(kernel))
    kernel.change(AHEAD, (KEY, LEFT_FRONT, 1))
    game_pad.read()
    kernel.change((KEY, LEFT_FRONT, 0))
    kernel.waiting = [(0, 3, 0), (0, 0, 0)]
    game_pad.read()
    assert not game_pad.is_held


def test_an_unplugged_pad_stays_disconnected(plug):
    kernel = pad()
    game_pad = open_pad(plug(kernel))
    kernel.change(AHEAD, (KEY, LEFT_FRONT, 1))
    game_pad.read()
    kernel.unplug()
    assert game_pad.read() == []
    assert game_pad.is_disconnected
    assert game_pad.direction() == (0.0, 0.0)


def test_a_reconnected_pad_commands_zero_until_its_stick_is_centred(plug):
    kernel = pad()
    kernel.change(AHEAD, (KEY, LEFT_FRONT, 1))
    game_pad = open_pad(plug(kernel))
    kernel.waiting.clear()
    game_pad.read()
    assert not game_pad.is_held
    assert "release" in game_pad.hint
    kernel.change((ABS, 1, 0))
    game_pad.read()
    assert not game_pad.is_held, "its front button is still pressed"
    kernel.change((KEY, LEFT_FRONT, 0))
    game_pad.read()
    kernel.change(AHEAD, (KEY, LEFT_FRONT, 1))
    game_pad.read()
    assert game_pad.direction() == (1.0, 0.0)


def test_an_axis_that_has_not_moved_gives_no_command(plug):
    kernel = bare_pad()
    game_pad = open_pad(plug(kernel))
    kernel.change((KEY, 0x124, 1))
    game_pad.read()
    assert game_pad.direction() == (0.0, 0.0), "value 0 of 0 … 255 is one end of its way"
    kernel.change((KEY, 0x124, 0), (ABS, 0, 128), (ABS, 1, 127))
    game_pad.read()
    kernel.change((KEY, 0x124, 1), (ABS, 0, 0))
    game_pad.read()
    assert game_pad.direction() == (0.0, 1.0)


def test_the_pad_is_selected_by_its_capabilities(plug):
    folder = plug(keyboard(), touchpad(), pad(name="Gamepad F310"))
    assert find_pad(folder=folder).name == "Gamepad F310"
    with refused("pad.lacks", UsageError, name="AT keyboard"):
        find_pad(folder / "event0")
    with refused("pad.lacks", UsageError, name="Touchpad"):
        find_pad(folder / "event1")
    assert find_pad(folder / "event2").name == "Gamepad F310"


def test_the_user_must_choose_between_two_pads(plug):
    folder = plug(pad(name="One"), pad(name="Other"))
    with refused("pad.several", UsageError, count=2):
        find_pad(folder=folder)


def test_a_missing_pad_is_reported_with_the_examined_devices(plug):
    folder = plug(keyboard(), touchpad(), KernelDevice("Wheel", (0x130,), {0: [0] * 6}))
    candidates = (
        'event0 "AT keyboard" (no stick), event1 "Touchpad" (no front buttons), event2 "Wheel" (no stick)'
    )
    with refused("pad.not-among", UsageError, devices=candidates):
        find_pad(folder=folder)


def test_a_folder_without_devices_is_reported(tmp_path):
    with refused("pad.none", UsageError):
        find_pad(folder=tmp_path / "input")


def test_unreadable_devices_are_reported_with_a_remedy(plug, monkeypatch):
    folder = plug(keyboard(), pad())

    def refuse_open(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(pads, "InputDevice", refuse_open)
    with refused("pad.closed", UsageError, locked_devices="event0, event1"):
        find_pad(folder=folder)
    with refused("pad.may-not-read", UsageError):
        find_pad(folder / "event1")


def test_a_path_that_is_not_a_device_is_reported(tmp_path):
    with refused("pad.not-evdev", UsageError):
        find_pad(tmp_path / "event7")
    (tmp_path / "js0").write_text("")
    with refused("pad.not-evdev", UsageError):
        find_pad(tmp_path / "js0")


def test_a_pad_on_another_system_than_linux_is_refused(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    with refused("pad.not-linux", UsageError):
        find_pad()


def test_a_button_of_the_pad_stops_the_vehicle(plug):
    kernel = pad()
    with cockpit(Terminal(), command_share=1.0, pad=open_pad(plug(kernel))) as (_, hand):
        kernel.change((KEY, EAST, 1))
        hand()
        assert hand.stop_reason(0).code == StopReason.DRIVER
