"""Check the Uno for `baqueano robot doctor`: the firmware on its line, and the losses in both directions.

Only the receiver of a frame can count it as damaged or lost. The Uno counts the frames that it misses and reports them
in its telemetry. To have enough frames to count, the checks send as many commands as in a drive, all with motors off.
"""

import time
from collections.abc import Callable, Iterator
from copy import copy
from typing import TYPE_CHECKING

from baqueano.errors import BaqueanoError
from baqueano.language import marked as N_
from baqueano.language import translated as _
from baqueano.robot.workshop.checks import Check

if TYPE_CHECKING:
    from baqueano.robot.uno.frames import Info
    from baqueano.robot.uno.link import Uno
    from baqueano.robot.uno.statistics import Statistics

COMMAND_EVERY_S = 0.01
FIRST_S = 0.1  # until telemetry shows the sequence of the last command
LOSS_WARN, LOSS_BAD = 1e-3, 0.05  # shares of frames
RAM, LEAST_RAM = 2048, 128  # bytes
QUIETER = N_("Keep the USB cable away from the motors' wires, and 100 nF across each motor")


def uno(port: str, least_battery_v: float, seconds: float = 2.0) -> Iterator[Check]:
    """Check the line, the firmware on it, its delay, and its losses in two seconds."""
    from baqueano.robot.uno.frames import AskInfo, Info
    from baqueano.robot.uno.serial_port import connected, find_port

    try:
        device_path = find_port(port)
        with connected(device_path) as link:
            yield Check(N_("serial line"), "ok", device_path)
            time.sleep(FIRST_S)
            before = copy(link.statistics)  # a frame whose beginning was missed counts as damaged
            send_commands(link, seconds, time.sleep)
            yield from answers(link, least_battery_v, before)
            yield memory(link.ask(AskInfo(), Info))  # INFO of its start comes before it has looked
    except BaqueanoError as error:
        yield Check(N_("serial line"), "bad", _("no Uno with our firmware"), str(error))


def send_commands(link: "Uno", seconds: float, wait: Callable[[float], object]) -> None:
    """Send as many commands as in a drive, each with the motors off."""
    for _tick in range(round(seconds / COMMAND_EVERY_S)):
        link.disarm()
        wait(COMMAND_EVERY_S)


def answers(
    link: "Uno", least_battery_v: float, before: "Statistics", wait: Callable[[float], object] = time.sleep
) -> Iterator[Check]:
    """Check a link that has received for a while, since its statistics were `before`."""
    from baqueano.robot.uno.frames import PROTOCOL, VERSION, Way

    info, telemetry = link.info, link.receive()
    if info is None:
        yield Check(
            N_("firmware"),
            "bad",
            _("the Uno was reset during the check"),
            _("Look at its supply, and try again"),
        )
        return
    has, own_version = (info.version_major, info.version_minor, info.version_patch), VERSION
    yield Check(
        N_("firmware"),
        "ok" if has == own_version else "warn",
        _(
            "{version}, protocol {protocol} (this baqueano: {ours}, {our_protocol})",
            version=".".join(map(str, has)),
            protocol=info.protocol,
            ours=".".join(map(str, own_version)),
            our_protocol=PROTOCOL,
        ),
        _("Type: baqueano robot flash"),
    )
    yield from line(link, before)
    yield at_uno(link.statistics, before, info)
    yield start(info)
    ppm = 1e6 * link.clock.skew
    yield Check(
        N_("Uno's clock"),
        "ok" if abs(ppm) < 5000.0 else "warn",
        _("{ppm:+.0f} ppm", ppm=-ppm),
        _("More than a resonator may be off: does the board run at 16 MHz?"),
    )
    if telemetry:
        yield battery(telemetry[-1].battery_v, least_battery_v)
    calibrated = any(way != Way() for way in link.settings(wait).ways)
    yield Check(
        N_("motors"),
        "ok" if calibrated else "warn",
        _("calibrated") if calibrated else _("not calibrated"),
        _("Type: baqueano robot calibrate motors"),
    )


def line(link: "Uno", before: "Statistics") -> Iterator[Check]:
    """Check the delay of the line, and its losses."""
    trips = sorted(link.statistics.trips_ms)
    if trips:
        middle, last = trips[len(trips) // 2], trips[-1]
        yield Check(
            N_("link round trip"),
            "ok" if last < 20.0 else "warn",
            _("{middle:.1f} ms, at most {last:.1f} of {trips}", middle=middle, last=last, trips=len(trips)),
            _("Use a short USB cable without a hub; look for another program that works hard"),
        )
    else:
        yield Check(N_("link round trip"), "bad", _("no answer to a ping"), _("Type: baqueano robot flash"))
    lost_frames, damaged_frames, came = link.statistics.since(before, "lost", "damaged", "received")
    yield Check(
        N_("frames"),
        of_share((lost_frames + damaged_frames) / max(1, came + lost_frames)),
        _("{came} came, {lost} lost, {damaged} damaged", came=came, lost=lost_frames, damaged=damaged_frames),
        _(QUIETER),
    )


def at_uno(now: "Statistics", before: "Statistics", info: "Info") -> Check:
    """Return the check of the Uno's counts of the frames sent to it; `info` is the INFO that it answered."""
    frames, spoilt, ignored_frames, overrun = now.since(before, "written", "spoilt", "ignored", "overrun")
    share = spoilt / max(1, frames)
    return Check(
        N_("frames to the Uno"),
        "warn" if (ignored_frames or overrun) and share < LOSS_BAD else of_share(share),
        _(
            "{written} sent, {spoilt} damaged ({share:.1f} %), {ignored} not obeyed, {overrun} bytes "
            "lost in its receiver; earlier, since its start, {earlier} damaged",
            written=frames,
            spoilt=spoilt,
            share=100.0 * share,
            ignored=ignored_frames,
            overrun=overrun,
            earlier=info.bad_crc + info.bad_shape,
        ),
        _(QUIETER)
        if spoilt
        else _("Is there another program on its line? If not, type: baqueano robot flash"),
    )


def start(info: "Info") -> Check:
    """Return the check of the last start's cause. The supply also sags at power-up."""
    from baqueano.robot.uno.frames import ResetCause, causes

    cause = info.reset_cause
    hung, brown_out = cause & (ResetCause.WATCHDOG | ResetCause.HUNG), cause & ResetCause.BROWN_OUT
    return Check(
        N_("Uno's start"),
        "warn" if hung or (brown_out and not cause & ResetCause.POWER) else "ok",
        _(
            "number {boots}, by {causes}",
            boots=info.boots,
            causes=causes(cause) or _("a cause that its boot-loader hides"),
        ),
        _("Its firmware hung. Type: baqueano robot flash")
        if hung
        else _("Its supply sagged: 1000 µF at the bridge, thick short wires, a converter of its own"),
    )


def memory(info: "Info") -> Check:
    """Return the check of the RAM that the Uno's stack never used; a larger stack would overwrite variables."""
    free = info.least_free_ram
    return Check(
        N_("Uno's memory"),
        "ok" if free >= LEAST_RAM else "warn",
        _("{free} of {ram} bytes were never used", free=free, ram=RAM),
        _("Is this our firmware, unchanged? Type: baqueano robot flash"),
    )


def of_share(lost: float) -> str:
    """Return the verdict on a share of lost frames."""
    return "ok" if lost < LOSS_WARN else "warn" if lost < LOSS_BAD else "bad"


def battery(volts: float, least_v: float) -> Check:
    """Return the check of the motors' battery, measured behind its divider."""
    if least_v <= 0.0:
        return Check(
            N_("battery"),
            "unknown",
            _("{volts:.2f} V at A0, if it is wired there", volts=volts),
            _("Set [robot] least_battery_v"),
        )
    low = "bad" if volts < least_v else "warn" if volts < 1.05 * least_v else "ok"
    return Check(
        N_("battery"),
        low,
        _("{volts:.2f} V, at least {least_v:g}", volts=volts, least_v=least_v),
        _("Charge it"),
    )
