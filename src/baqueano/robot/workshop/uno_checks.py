"""Check the Uno for `baqueano robot doctor`: the firmware on its line, and the losses in both directions.

Only the receiver of a frame can count it as damaged or lost. The telemetry of the Uno reports how many frames it
missed. The checks send as many commands as a drive, all with the motors off, so that there are enough frames to count.
"""

import time
from collections.abc import Callable, Iterator
from copy import copy
from typing import TYPE_CHECKING

from baqueano.errors import BaqueanoError
from baqueano.messages.language import mark as N_, translate as _
from baqueano.robot.workshop.checks import Check

if TYPE_CHECKING:
    from baqueano.robot.uno.frames import Info
    from baqueano.robot.uno.link import Uno
    from baqueano.robot.uno.statistics import Statistics

COMMAND_PERIOD_S = 0.01
FIRST_ANSWER_S = 0.1  # time until telemetry shows the sequence of the last command
LOSS_WARN, LOSS_BAD = 1e-3, 0.05  # shares of frames
RAM, MIN_RAM = 2048, 128  # bytes
NOISE_REMEDY = N_("Keep the USB cable away from the motors' wires, and put 100 nF across each motor")


def check_uno(port: str, least_battery_v: float, seconds: float = 2.0) -> Iterator[Check]:
    """Yield the checks of the serial line, of the firmware, and of delay and losses within `seconds`."""
    from baqueano.robot.uno.frames import AskInfo, Info
    from baqueano.robot.uno.serial_port import find_port, open_uno

    try:
        device_path = find_port(port)
        with open_uno(device_path) as link:
            yield Check(N_("serial line"), "ok", device_path)
            time.sleep(FIRST_ANSWER_S)
            # excludes a first frame that was received without its beginning
            first_counts = copy(link.statistics)
            send_commands(link, seconds, time.sleep)
            yield from check_answers(link, least_battery_v, first_counts)
            yield check_memory(link.request(AskInfo(), Info))  # the INFO sent at boot is older
    except BaqueanoError as error:
        yield Check(N_("serial line"), "bad", _("an Uno with our firmware was not found"), str(error))


def send_commands(link: "Uno", seconds: float, wait: Callable[[float], object]) -> None:
    """Send as many commands as in a drive of this duration [s], each with the motors off."""
    for _tick in range(round(seconds / COMMAND_PERIOD_S)):
        link.disarm()
        wait(COMMAND_PERIOD_S)


def check_answers(
    link: "Uno", least_battery_v: float, previous: "Statistics", wait: Callable[[float], object] = time.sleep
) -> Iterator[Check]:
    """Yield the checks of a link, with the losses since the statistics `previous`."""
    from baqueano.robot.uno.frames import PROTOCOL, VERSION, WheelCurve

    info, telemetry = link.info, link.receive()
    if info is None:
        yield Check(
            N_("firmware"),
            "bad",
            _("the Uno was reset during the check"),
            _("Check its supply, and try again"),
        )
        return
    firmware_version, own_version = (info.version_major, info.version_minor, info.version_patch), VERSION
    yield Check(
        N_("firmware"),
        "ok" if firmware_version == own_version else "warn",
        _(
            "{version}, protocol {protocol} (this baqueano: {ours}, {our_protocol})",
            version=".".join(map(str, firmware_version)),
            protocol=info.protocol,
            ours=".".join(map(str, own_version)),
            our_protocol=PROTOCOL,
        ),
        _("Type: baqueano robot flash"),
    )
    yield from check_link(link, previous)
    yield check_received_frames(link.statistics, previous, info)
    yield check_last_start(info)
    ppm = 1e6 * link.clock.skew
    yield Check(
        N_("Uno's clock"),
        "ok" if abs(ppm) < 5000.0 else "warn",
        _("{ppm:+.0f} ppm", ppm=-ppm),
        _("This error is too large for a resonator: does the board run at 16 MHz?"),
    )
    if telemetry:
        yield check_battery(telemetry[-1].battery_v, least_battery_v)
    is_calibrated = any(curve != WheelCurve() for curve in link.settings(wait).curves)
    yield Check(
        N_("motors"),
        "ok" if is_calibrated else "warn",
        _("calibrated") if is_calibrated else _("not calibrated"),
        _("Type: baqueano robot calibrate motors"),
    )


def check_link(link: "Uno", previous: "Statistics") -> Iterator[Check]:
    """Yield the checks of the line's round-trip time, and of lost and damaged frames since `previous`."""
    trips = sorted(link.statistics.trips_ms)
    if trips:
        median_trip, max_trip = trips[len(trips) // 2], trips[-1]
        yield Check(
            N_("link round trip"),
            "ok" if max_trip < 20.0 else "warn",
            _(
                "{middle:.1f} ms, at most {last:.1f} of {trips}",
                middle=median_trip,
                last=max_trip,
                trips=len(trips),
            ),
            _("Use a short USB cable without a hub, and look for another program that loads the processor"),
        )
    else:
        yield Check(N_("link round trip"), "bad", _("no answer to a ping"), _("Type: baqueano robot flash"))
    lost_frames, damaged_frames, received_frames = link.statistics.since(
        previous, "lost_frames", "damaged_frames", "received_frames"
    )
    yield Check(
        N_("frames"),
        loss_verdict((lost_frames + damaged_frames) / max(1, received_frames + lost_frames)),
        _(
            "{received} received, {lost} lost, {damaged} damaged",
            received=received_frames,
            lost=lost_frames,
            damaged=damaged_frames,
        ),
        _(NOISE_REMEDY),
    )


def check_received_frames(current: "Statistics", previous: "Statistics", info: "Info") -> Check:
    """Return the check of the frames sent to the Uno, from the counts of the Uno; `info` is its INFO."""
    frames, damaged_frames, ignored_frames, lost_bytes = current.since(
        previous, "written_frames", "rejected_frames", "ignored_frames", "overrun_bytes"
    )
    share = damaged_frames / max(1, frames)
    return Check(
        N_("frames to the Uno"),
        "warn" if (ignored_frames or lost_bytes) and share < LOSS_BAD else loss_verdict(share),
        _(
            "{frames} sent, {damaged} damaged ({share:.1f} %), {ignored} ignored, {lost_bytes} bytes lost in "
            "its receiver; earlier, since its start, {earlier} damaged",
            frames=frames,
            damaged=damaged_frames,
            share=100.0 * share,
            ignored=ignored_frames,
            lost_bytes=lost_bytes,
            earlier=info.bad_crc + info.bad_shape,
        ),
        _(NOISE_REMEDY)
        if damaged_frames
        else _("Does another program use its line? If not, type: baqueano robot flash"),
    )


def check_last_start(info: "Info") -> Check:
    """Return the check of the cause of the Uno's last start; a brown-out at power-up is not a fault."""
    from baqueano.robot.uno.frames import ResetCause, reset_cause_names

    cause = info.reset_cause
    hung, brown_out = cause & (ResetCause.WATCHDOG | ResetCause.HUNG), cause & ResetCause.BROWN_OUT
    return Check(
        N_("Uno's start"),
        "warn" if hung or (brown_out and not cause & ResetCause.POWER) else "ok",
        _(
            "number {boots}, by {causes}",
            boots=info.boots,
            causes=" ".join(map(_, reset_cause_names(cause).split()))
            or _("a cause that its boot-loader hides"),
        ),
        _("Its firmware hung. Type: baqueano robot flash")
        if hung
        else _(
            "Its supply voltage dropped. Use 1000 µF at the bridge, short thick wires and a separate converter"
        ),
    )


def check_memory(info: "Info") -> Check:
    """Return the check of the RAM that the Uno's stack has never used. Too large a stack overwrites variables."""
    free = info.least_free_ram
    return Check(
        N_("Uno's memory"),
        "ok" if free >= MIN_RAM else "warn",
        _("{free} of {ram} bytes were never used", free=free, ram=RAM),
        _("Is this our firmware, unchanged? Type: baqueano robot flash"),
    )


def loss_verdict(lost_share: float) -> str:
    """Return the verdict on a share of lost frames, 0 to 1."""
    return "ok" if lost_share < LOSS_WARN else "warn" if lost_share < LOSS_BAD else "bad"


def check_battery(volts: float, min_v: float) -> Check:
    """Return the check of the voltage of the motors' battery. The verdict is "unknown" if `min_v` is 0."""
    if min_v <= 0.0:
        return Check(
            N_("battery"),
            "unknown",
            _("{volts:.2f} V at A0, if it is wired there", volts=volts),
            _("Set [robot] least_battery_v"),
        )
    low = "bad" if volts < min_v else "warn" if volts < 1.05 * min_v else "ok"
    return Check(
        N_("battery"),
        low,
        _("{volts:.2f} V, at least {least_v:g}", volts=volts, least_v=min_v),
        _("Charge it"),
    )
