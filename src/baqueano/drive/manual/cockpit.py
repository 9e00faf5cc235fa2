"""Combine keys, a game pad, a display and a heartbeat of the terminal into one source of commands, for manual driving.

  u = command_share · limit · (forward, 0, left) · min(1, FULL_SPEED_DELAY_MS / T)                                   (1)

T is the round-trip time between the driver and the vehicle. If it is longer than FULL_SPEED_DELAY_MS, the vehicle
drives more slowly, so that the distance driven during T is not longer than at FULL_SPEED_DELAY_MS.

`pop_messages` returns the other requests for a remote vehicle (door/remote.py); `stop_reason` and `pop_mark_count`
return them for a world in this process. The vehicle stops permanently if the driver presses space or the stop button of
the pad. It also stops if the terminal is lost (no answer for 0.35 s, or closed), or if the pad is unplugged. A caller
can also call `stop`, for example if a signal (SIGHUP, SIGTERM) ends the program.

A terminal that does not answer queries cannot confirm that it is connected. The commands then follow from the
characters that it repeats, each valid for a limited time (key_hold.py), and a set-point cannot be latched.
"""

import time
from collections.abc import Callable, Sequence
from types import TracebackType

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.controllers.heading_hold import MAX_TURN_SHARE
from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.drive.health import degraded_note
from baqueano.drive.manual import pad as pads, screen
from baqueano.drive.manual.dead_zone import dead_zone_violation
from baqueano.drive.manual.key_hold import LATCHED, RELEASES, REPEATS, KeyHold
from baqueano.drive.manual.keys import KITTY, PRESS, QUERY_ANSWER, KeyEvent
from baqueano.drive.manual.terminal_heartbeat import MAX_FIRST_ANSWER_S, Heartbeat
from baqueano.drive.manual.tty import Terminal, open_terminal
from baqueano.drive.observers import Observer
from baqueano.loop import Record
from baqueano.messages import text
from baqueano.messages.language import mark as N_, translate as _
from baqueano.vehicles.drivetrain import Drivetrain

KITTY_QUERY = b"\x1b[?u"
RELEASES_ON, RELEASES_OFF = b"\x1b[>11u", b"\x1b[<u"  # 1 distinct keys + 2 kinds + 8 all keys
WINDOW_ON, WINDOW_OFF = b"\x1b[?1004h", b"\x1b[?1004l"
DRAW_PERIOD_S = 0.1
MIN_SHARE, SHARE_STEP = 0.1, 0.1
PAUSE_S = 0.01
FULL_SPEED_DELAY_MS = 80.0
KEY_HINTS = {
    RELEASES: N_("hold to drive"),
    REPEATS: N_("hold to drive, press briefly for a short move"),
    LATCHED: N_("latched: each press adds a step"),
}
INCREASE_HINTS = {RELEASES: N_("press +"), REPEATS: N_("press +"), LATCHED: N_("that key again, or +")}


class Cockpit(Observer):
    """`with Cockpit(file.command.limit) as hand: …`; `hand()` returns the present command (n,) of the driver.

    `limit` (n,) is the command limit, and `command_share` the part of it for a full key. `hold` is True if the
    heading is held during straight motion; the display then shows the correction. `drivetrain` is the drivetrain of the
    vehicle file: the display reports a command below its dead zone. `has_heartbeat` is False if another program answers
    instead of the terminal (tmux on the vehicle).
    """

    def __init__(
        self,
        limit: np.ndarray,
        line: Terminal | None = None,
        *,
        name: str = "",
        names: tuple[str, ...] = ("u_x", "u_y", "u_psi"),
        command_share: float = 0.5,
        latched: bool = False,
        hold: bool = False,
        drivetrain: Drivetrain | None = None,
        pad: pads.Pad | None = None,
        has_heartbeat: bool = True,
        now: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._limit = np.where(np.isfinite(limit), limit, 1.0)
        n = len(self._limit)
        self.status = screen.Status(
            name, driver_command=np.zeros(n), motor_command=np.zeros(n), names=names, limit=self._limit,
            command_share=command_share, hold_command=float("nan") if hold else None,
        )  # fmt: skip
        self._drivetrain = drivetrain
        self._given_line, self._pad, self._has_heartbeat, self._is_latch_requested = (
            line,
            pad,
            has_heartbeat,
            latched,
        )
        self._now, self._sleep = now, sleep
        self._screen, self._drawn_s = screen.Screen(), float("-inf")
        self._begun_s = now()
        self._stop: Diagnostic | None = None
        self._is_ended, self._stop_sent = False, False
        self._marks, self._new_marks, self._sent_marks = 0, 0, 0

    def __enter__(self) -> "Cockpit":
        self._line = open_terminal() if self._given_line is None else self._given_line
        self._heartbeat = Heartbeat(
            self._line.write if self._has_heartbeat and self._line.can_answer else lambda data: None
        )
        try:
            self._query_terminal()
        except BaseException:
            self._line.close()
            raise
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        end_s = self._now() + 3.0 * 1e-3 * min(200.0, np.nan_to_num(self._heartbeat.round_trip_ms, nan=0.0))
        while self._now() < end_s and self._line.read() is not None:  # the answers to the last queries
            self._sleep(PAUSE_S)
        self._line.close()
        if self._pad is not None:
            self._pad.close()

    def __call__(self) -> np.ndarray:
        """Return the present command (n,) of the driver.

        Raise KeyboardInterrupt once the driver has ended the drive.
        """
        has_unsent_marks = self._new_marks and self._sent_marks < self._marks
        if self._is_ended and not has_unsent_marks:
            raise KeyboardInterrupt
        now_s = self._now()
        self._process_input(now_s)
        forward, left = (0.0, 0.0) if self._stop or self._is_ended else self._direction(now_s)
        u = np.zeros(len(self._limit))
        u[0], u[-1] = forward, left
        self.status.driver_command = u * self.status.command_share * self._limit * self.delay_factor  # (1)
        self.status.standstill_reason = self._standstill_reason()
        self._draw_status(now_s)
        return self.status.driver_command.copy()

    @property
    def delay_factor(self) -> float:
        """Return the share of the speed, in (0, 1], that the present round-trip time allows.  (1)"""
        delays = [ms for ms in (self.status.link_ms, self.status.terminal_ms) if np.isfinite(ms)]
        return min(1.0, FULL_SPEED_DELAY_MS / max(sum(delays), 1e-3))

    def stop(self, reason: Diagnostic) -> None:
        """Stop the vehicle permanently. The reason of an earlier stop is kept."""
        self._stop = self._stop or reason
        self.status.reason = text(self._stop)

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the reason to stop the vehicle, or None to continue."""
        return self._stop

    def pop_mark_count(self) -> int:
        """Return how often the driver has reported "on the mark" since the last call."""
        new_count, self._new_marks = self._new_marks, 0
        return new_count

    def pop_messages(self) -> list[TableRow]:
        """Return the driver's messages to the vehicle since the last call: marks, and a stop."""
        commands: list[TableRow] = [{"type": "mark"}] * (self._marks - self._sent_marks)
        self._sent_marks = self._marks
        if self._stop and not self._stop_sent:
            self._stop_sent = True
            commands.append({"type": "stop", "reason": self._stop})
        return commands

    def on_record(self, record: Record) -> None:
        """Show a tick on the display, for a world in this process."""
        self.status.motor_command = np.asarray(record.tick.u)
        self._update_hold(record.requested_command.u)
        self.status.speed_m_s = float(record.estimate.nu[0])
        self.status.yaw_rate_rad_s = float(record.estimate.nu[2])
        self.status.sensor_text = text(degraded_note(record.sensor_findings))

    def show(self, state: JsonObject) -> None:
        """Show the state of a remote vehicle on the display."""
        s = self.status
        s.state, s.reason = str(state.get("state", "")), text(self._stop or state.get("reason"))
        for name in ("battery_v", "speed_m_s", "yaw_rate_rad_s", "link_ms"):
            setattr(s, name, float("nan") if state.get(name) is None else float(state[name]))
        s.sensor_text = text(state.get("degraded"))
        if state.get("u") is not None and len(state["u"]) == len(self._limit):
            s.motor_command = np.array(state["u"], dtype=float)
            self._update_hold(state.get("requested", state["u"]))

    def show_message(self, line: str) -> None:
        """Show a message to the driver in the last line of the display."""
        self.status.message = line

    def _update_hold(self, requested_u: Sequence[float] | np.ndarray) -> None:
        """Update the turn command of the heading hold on the display. It is NaN unless the driver drives straight."""
        s, turn = self.status, float(requested_u[-1])
        if s.hold_command is not None:
            is_straight = s.driver_command[0] != 0.0 and s.driver_command[-1] == 0.0
            s.hold_command = (
                turn if is_straight and abs(turn) <= MAX_TURN_SHARE * self._limit[-1] else float("nan")
            )

    def _standstill_reason(self) -> str:
        """Return, as text for the display, why the vehicle stays at rest although the driver commands motion.

        Return "" if the vehicle can move, or during the slow motion of a tap, which is too short to read a reason.
        """
        is_pad_held = self._pad is not None and self._pad.is_held
        violation = None
        if is_pad_held or not self._key_hold.is_nudge:
            violation = dead_zone_violation(self._drivetrain, self.status.driver_command)
        if violation is None:
            return ""
        advice = _("push further, or press +") if is_pad_held else _(INCREASE_HINTS[self._key_hold.mode])
        return _(
            "{channel:.2f} is below the dead zone of {dead_zone:.2f}: nothing moves; {more}",
            channel=violation.channel, dead_zone=violation.dead_zone, more=advice,
        )  # fmt: skip

    def _query_terminal(self) -> None:
        """Send queries to the terminal. Its answers determine how long a key is valid (key_hold.py)."""
        start_s, releases = self._now(), False
        if self._line.can_answer:
            self._line.write(KITTY_QUERY)
        while (
            self._line.can_answer
            and self._has_heartbeat
            and not self._heartbeat.has_answered
            and self._now() - start_s < MAX_FIRST_ANSWER_S
        ):
            self._heartbeat.poll(self._now())
            for event in self._line.read() or []:
                releases = releases or event.kind == KITTY
                if event.kind == QUERY_ANSWER:
                    self._heartbeat.record_answer(self._now())
            self._sleep(PAUSE_S)
        has_answered = self._heartbeat.has_answered
        if has_answered and releases:
            self._line.set_mode(RELEASES_ON, RELEASES_OFF)
        if has_answered:
            self._line.set_mode(WINDOW_ON, WINDOW_OFF)
        self._plain_key_mode = RELEASES if has_answered and releases else REPEATS
        self._key_hold = KeyHold(
            LATCHED if has_answered and self._is_latch_requested else self._plain_key_mode
        )
        self.status.key_mode = KEY_HINTS[self._key_hold.mode]
        if not has_answered:
            self.show_message(
                _("this terminal does not confirm that it is active: each key counts for a short time")
            )

    def _process_input(self, now_s: float) -> None:
        """Process the events of keys and pad since the last call, and stop if the terminal or the pad is lost."""
        self._heartbeat.poll(now_s)
        events = self._line.read()
        if events is None:
            self.stop(stop(StopReason.TERMINAL_CLOSED))
        for event in events or []:
            self._process_event(event, now_s)
        if self._heartbeat.is_lost(now_s):
            self.stop(stop(StopReason.TERMINAL_SILENT, silent_ms=1e3 * self._heartbeat.silence_s(now_s)))
        self.status.terminal_ms = self._heartbeat.round_trip_ms
        self.status.delay_factor = self.delay_factor
        if self._pad is not None:
            for button in self._pad.read():
                self._process_event(
                    KeyEvent(PRESS, "m" if button in pads.MARK else " " if button in pads.STOP else ""), now_s
                )
            if self._pad.is_disconnected:
                self.stop(stop(StopReason.PAD_UNPLUGGED))
            self.status.pad = self._pad.hint

    def _process_event(self, event: KeyEvent, now_s: float) -> None:
        if event.kind == QUERY_ANSWER:
            self._heartbeat.record_answer(now_s)
        self._key_hold.on_key(event, now_s)
        if event.kind != PRESS:
            return
        match event.key:
            case "q" | "ctrl-c":
                self._is_ended = True
            case " ":
                self.stop(stop(StopReason.DRIVER))
            case "m":
                self._marks, self._new_marks = self._marks + 1, self._new_marks + 1
                self.status.mark_count = self._marks
            case "+" | "=" | "-":
                step = SHARE_STEP if event.key != "-" else -SHARE_STEP
                self.status.command_share = min(
                    1.0, max(MIN_SHARE, round(self.status.command_share + step, 6))
                )
            case "l":
                self._toggle_latch()

    def _toggle_latch(self) -> None:
        """Switch between latched set-points and held keys, with a zero command at first.

        Do nothing if the terminal does not answer.
        """
        if not self._heartbeat.has_answered:
            return
        self._key_hold.release_all()
        self._key_hold.mode = self._plain_key_mode if self._key_hold.mode == LATCHED else LATCHED
        self.status.key_mode = KEY_HINTS[self._key_hold.mode]

    def _direction(self, now_s: float) -> tuple[float, float]:
        if self._pad is not None and self._pad.is_held:
            return self._pad.direction()
        return self._key_hold.direction(now_s)

    def _draw_status(self, now_s: float) -> None:
        if now_s - self._drawn_s < DRAW_PERIOD_S:
            return
        self._drawn_s, self.status.t_s = now_s, now_s - self._begun_s
        columns, height = self._line.size()
        self._line.write(self._screen.frame(screen.status_lines(self.status, columns), height))
