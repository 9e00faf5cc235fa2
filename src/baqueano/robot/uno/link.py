"""Connect the host with the Uno: send commands and receive telemetry, with calls that do not wait for the line.

    Uno          the messages in both directions, over any port, without waiting and without a thread     (this file)
    serial_port  a real line, with a thread that reads the line, and opens it again after a disconnection

A command is never sent twice: each DRIVE was computed by the present step of the control loop. If the loop hangs, no
command is sent, and the firmware's dead-man timer stops the motors. The loop then does not continue without the
operator (standstill.py). A reset of the Uno, by a brown-out or a disconnected cable, changes its nonce: the Uno then
ignores commands until it is armed again.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

from baqueano.diagnostics import Diagnostic, StopReason, stop
from baqueano.errors import RobotUnreachable
from baqueano.robot.uno.clock import WRAP_US, UnoClock
from baqueano.robot.uno.codec import Decoder, ReceivedFrame, encode
from baqueano.robot.uno.frames import (
    AskInfo,
    AskSettings,
    Config,
    Drive,
    DriveFlag,
    Frame,
    Info,
    Ping,
    Pong,
    Settings,
    State,
    StateFlag,
    Stop,
    reset_cause_names,
)  # fmt: skip
from baqueano.robot.uno.standstill import Standstill
from baqueano.robot.uno.statistics import Statistics
from baqueano.worlds.robot import Telemetry, count_increase

PING_PERIOD_S = 0.1
MAX_TELEMETRY = 2000  # maximum number of telemetry frames kept for the caller: 20 s
ANSWER_S = 1.0  # timeout of a request outside a drive
REPEAT_PERIOD_S = 0.2
SILENCE_US = 500_000  # during this time fewer than 128 frames are sent
ARM_DELAY_S = 0.01  # the Uno receives a frame within this time; later telemetry shows it
ARMING_TIMEOUT_S = 0.2  # time for which arming is repeated before `stop_cause` is set
MAX_COMMANDS_AHEAD = 64  # maximum number of commands on their way; the firmware regards 128 ahead as old
LATCHED_STOPS = (StopReason.UNO_LATCHED, StopReason.UNO_BATTERY)  # kept while telemetry reports them
Reply = TypeVar("Reply")


class Port(Protocol):
    """A port that sends and receives bytes without waiting."""

    def write(self, data: bytes) -> None:
        """Send the bytes. Raise OSError if the line is disconnected or full."""
        ...

    def read(self) -> bytes:
        """Return the bytes that have arrived since the last call, b"" if none have."""
        ...


class PreviousTelemetry(NamedTuple):
    """The last telemetry, with its times, for the comparison with the next telemetry."""

    state: State
    t_us: int
    t_ns: int


class Uno:
    """The link to the firmware at the other end of `port`; `now_ns` is the clock of the host.

    Telemetry arrives each `Config.telemetry_ms` and is kept until `receive` returns it. `stop_cause` is the reason why
    the motors do not run, None if they can run.

    >>> from baqueano.robot.uno.serial_port import open_uno
    >>> with open_uno() as uno:  # an Uno on a real line, whose thread calls pump()
    ...     uno.arm()
    ...     uno.drive(0.2, -0.2)  # duties, left and right; without another one the firmware soon stops the motors
    ...     print(uno.info.protocol, uno.stop_cause)
    1 None
    """

    def __init__(self, port: Port, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.statistics, self.clock = Statistics(), UnoClock()
        self.info: Info | None = None
        self.stop_cause: Diagnostic | None = None  # why the motors do not run although the Uno was armed
        self.noise_ns = -(1 << 62)  # time of the last damaged frame
        self._port, self._now_ns, self._decoder = port, now_ns, Decoder()
        self._standstill = Standstill(now_ns)
        self._telemetry: deque[Telemetry] = deque(maxlen=MAX_TELEMETRY)
        self._replies: dict[type, Any] = {}
        self._pings: dict[int, int] = {}
        self._previous: PreviousTelemetry | None = None
        self._nonce: int | None = None  # nonce in the last frame of the firmware
        self._drive_seq, self._seq_received, self._token, self._pinged_ns = 0, -1, 0, -(1 << 62)
        self._is_armed, self._is_confirmed, self._stop_sent, self._damaged_count = False, False, False, 0
        self._armed_ns = 0  # time of `arm`
        self._unarmed_ns: int | None = None  # time since which telemetry shows the Uno as not armed
        self._lock = threading.RLock()  # a listening thread and the loop share the line

    def drive(self, left: float, right: float) -> None:
        """Send duties in [-1, 1] once, if the Uno is armed. After a standstill of the computer, disarm it instead."""
        self.standstill_reason()
        self._standstill.record_command()
        if self.info is None or not self._is_armed:
            self.statistics.unsent_commands += not self._stop_sent
            return
        if self._unarmed_ns is not None:
            self._drive(0, 0, DriveFlag.ARM)  # otherwise the Uno does not execute the command
        ok = self._drive(permille(left), permille(right), DriveFlag.ARM)
        self.statistics.sent_commands += ok
        self.statistics.unsent_commands += not ok

    def arm(self) -> None:
        """Arm the Uno, so that it executes the following commands; the first command requests zero duty.

        The zero request is repeated before each command until telemetry shows that the Uno is armed. If this takes
        longer than ARMING_TIMEOUT_S, `stop_cause` is set.
        """
        with self._lock:
            self._is_armed, self._is_confirmed, self._stop_sent, self.stop_cause = True, False, False, None
            self._standstill.reset()
            self._armed_ns, self._unarmed_ns = self._now_ns(), None
            self._drive_seq = self._drive_seq if self._previous is None else self._previous.state.drive_seq
        self.drive(0.0, 0.0)

    def disarm(self) -> None:
        """Switch the motors off and the bridge to standby, and clear `stop_cause`, except a latch or a low battery."""
        with self._lock:
            self._is_armed = False
            self._clear_stop_cause()
        self._drive(0, 0, 0)

    def stop(self) -> None:
        """Send a stop, which the Uno executes in any state and latches. Any thread can call it."""
        self._stop_sent, self._is_armed = True, False  # in this order: another thread may call `drive`
        self._send(Stop())

    def clear_stop(self) -> None:
        """Clear the latch of `stop` and former values of `stop_cause`. The vehicle drives only after it is armed.

        `stop_cause` stays UNO_LATCHED until telemetry shows that the latch is cleared, because this frame can be lost
        on the line.
        """
        with self._lock:
            self._clear_stop_cause()
        self._drive(0, 0, DriveFlag.CLEAR_STOP)

    def _clear_stop_cause(self) -> None:
        self._standstill.reset()
        if not self._is_latched:
            self.stop_cause = None

    @property
    def _is_latched(self) -> bool:
        return self.stop_cause is not None and self.stop_cause.code in LATCHED_STOPS

    def receive(self) -> list[Telemetry]:
        """Return the telemetry that has arrived since the last call, in order."""
        self.pump()
        return [self._telemetry.popleft() for _ in range(len(self._telemetry))]

    def standstill_reason(self) -> Diagnostic | None:
        """Disarm after a standstill of the computer, and return the reason to stop; None without a standstill."""
        config = Config() if self.info is None else self.info.config
        if self._is_armed and (reason := self._standstill.check(config.dead_man_ms)):
            with self._lock:
                self._is_armed, self.stop_cause = False, reason
            self._drive(0, 0, 0)
        return self._standstill.reason

    def pump(self) -> None:
        """Process the bytes that have arrived, and send a ping if one is due."""
        with self._lock:
            self._pump()

    def _pump(self) -> None:
        try:
            data = self._port.read()
        except OSError:
            return
        now_ns = self._now_ns()
        for received_frame in self._decoder.feed(data) if data else ():
            self._process(received_frame, now_ns)
        damaged_frames = self._decoder.bad_crc + self._decoder.bad_shape
        if damaged_frames > self._damaged_count:
            self.noise_ns = now_ns
            self.statistics.damaged_frames += damaged_frames - self._damaged_count
        self._damaged_count = damaged_frames
        if now_ns - self._pinged_ns >= PING_PERIOD_S * 1e9:
            self._pinged_ns, self._token = now_ns, (self._token + 1) & 0xFFFFFFFF
            if self._send(Ping(self._token)):
                self._pings[self._token] = now_ns
            for old_token in [t for t in self._pings if self._token - t > 10]:
                del self._pings[old_token]
            if self.info is None:
                self._send(AskInfo())

    def on_reopen(self) -> None:
        """Reset the state after the line was opened again, so that the firmware is identified again."""
        self.info, self._decoder, self._damaged_count = None, Decoder(), 0
        self._pings.clear()

    # outside a drive: question and answer

    def request(
        self,
        question: Any,
        answer: type[Reply],
        wait: Callable[[float], object] = time.sleep,
        accepts: Callable[[Reply], bool] = lambda reply: True,
    ) -> Reply:
        """Send a request until a reply satisfies `accepts`, and return that reply; an older reply can arrive first.
        Raise RobotUnreachable if no such reply arrives within ANSWER_S."""
        received_reply: Any = None
        self._replies.pop(answer, None)
        end_ns, retry_ns = self._now_ns() + round(ANSWER_S * 1e9), 0
        while self._now_ns() < end_ns:
            if self._now_ns() >= retry_ns:
                self._send(question)
                retry_ns = self._now_ns() + round(REPEAT_PERIOD_S * 1e9)
            wait(0.002)
            self.pump()
            received_reply = self._replies.pop(answer, received_reply)
            if received_reply is not None and accepts(received_reply):
                return received_reply
        if received_reply is not None:
            raise RobotUnreachable.of("uno.refused-number", question=str(question), reply=str(received_reply))
        if self._now_ns() - self.noise_ns < ANSWER_S * 1e9:
            raise RobotUnreachable.of(
                "uno.answer-not-whole", question=type(question).__name__, limit_s=ANSWER_S
            )
        raise RobotUnreachable.of(
            "uno.no-answer", "baqueano robot flash", question=type(question).__name__, limit_s=ANSWER_S
        )

    def configure(self, config: Config, wait: Callable[[float], object] = time.sleep) -> Info:
        """Set the configuration until the next reset, and return the new INFO. It raises the errors of `request`."""
        return self.request(config, Info, wait, lambda info: info.config == config)

    def send_config(self, config: Config) -> None:
        """Send `config` once without waiting. If it arrives, a later INFO contains it (`info.config`)."""
        self._send(config)

    def settings(self, wait: Callable[[float], object] = time.sleep) -> Settings:
        """Return the settings that the Uno stores in its EEPROM. It raises the errors of `request`."""
        return self.request(AskSettings(), Settings, wait)

    def store_settings(self, settings: Settings, wait: Callable[[float], object] = time.sleep) -> None:
        """Write `settings` into the EEPROM of the Uno, which must be disarmed. It raises the errors of `request`."""
        self.request(settings, Settings, wait, lambda reply: reply == settings)

    # received frames

    def _drive(self, left: int, right: int, flags: int) -> bool:
        """Send a DRIVE; return False if it could not be sent. DRIVE frames have a separate sequence, because the
        firmware compares it with the last DRIVE that it executed."""
        with self._lock:
            info, self._drive_seq = self.info, (self._drive_seq + 1) & 0xFF
            return info is not None and self._send(Drive(info.nonce, left, right, flags), self._drive_seq)

    def _send(self, frame: Frame, seq: int = 0) -> bool:
        with self._lock:
            try:
                self._port.write(encode(frame, seq))
            except OSError:
                return False
            self.statistics.written_frames += 1
            return True

    def _process(self, received_frame: ReceivedFrame, now_ns: int) -> None:
        self.statistics.received_frames += 1
        if isinstance(received_frame.frame, State | Info):
            self._check_boot(received_frame.frame)
        if not self._is_in_sequence(received_frame):
            self.statistics.late_frames += 1
            if not self._is_newer(received_frame.frame):
                return
        match received_frame.frame:
            case State() as state:
                self._on_state(state, now_ns)
            case Pong(token, t_us) if token in self._pings:
                sent_ns = self._pings.pop(token)
                self.statistics.trips_ms.append((now_ns - sent_ns) / 1e6)
                self.clock.add_ping(sent_ns, self.clock.unwrap(t_us), now_ns)
            case Info() as info:
                self.info = self._replies[Info] = info
            case frame:
                self._replies[type(frame)] = frame

    def _is_in_sequence(self, received_frame: ReceivedFrame) -> bool:
        """Return True if this frame is the newest so far, and count the frames lost before it. After a long silence
        the sequence is ambiguous, so the time of the telemetry decides."""
        steps_ahead = (received_frame.seq - self._seq_received) & 0xFF
        if (
            self._seq_received >= 0
            and not 0 < steps_ahead < 128
            and not self._is_newer(received_frame.frame, SILENCE_US)
        ):
            return False
        if self._seq_received >= 0:
            self.statistics.lost_frames += (steps_ahead - 1) & 0xFF
        self._seq_received = received_frame.seq
        return True

    def _is_newer(self, frame: Frame, min_step_us: int = 0) -> bool:
        """Return True if this telemetry is more than `min_step_us` newer than the last telemetry.

        The first telemetry and an INFO are newer only if `min_step_us` is 0.
        """
        if not isinstance(frame, State) or self._previous is None:
            return min_step_us == 0 and isinstance(frame, State | Info)
        return min_step_us < (frame.t_us - self._previous.state.t_us) % WRAP_US < WRAP_US // 2

    def _check_boot(self, frame: State | Info) -> None:
        """Detect a restart of the firmware by its nonce, even if the line was disconnected at that time."""
        if self._nonce is not None and frame.nonce != self._nonce:
            self.info = None  # `_pump` will request it again
            self._on_restart(frame.reset_cause if isinstance(frame, Info) else 0)
        self._nonce = frame.nonce

    def _on_restart(self, cause: int) -> None:
        """Reset the state after a restart of the firmware, which is disarmed and starts its clock and counts at 0."""
        self.statistics.resets += 1
        self.clock, self._previous, self._seq_received = UnoClock(), None, -1
        if self._is_armed:
            self.stop_cause = stop(StopReason.UNO_RESET, cause=reset_cause_names(cause) or "cause unknown")
        self._is_armed = self._is_confirmed = False

    def _on_state(self, state: State, now_ns: int) -> None:
        if (self._drive_seq - state.drive_seq) & 0xFF > MAX_COMMANDS_AHEAD:  # lost on the line, or refused
            self._drive_seq = state.drive_seq
        t_us = self.clock.unwrap(state.t_us)
        t_ns = min(self.clock.host_ns(t_us), now_ns) if self.clock.is_synchronised else now_ns
        previous = self._previous
        if previous is not None:
            t_ns = max(t_ns, previous.t_ns + 1)
            self._count_errors(previous.state, state)
        self._previous = PreviousTelemetry(state, t_us, t_ns)
        self._update_stop_cause(state, t_ns)
        self._telemetry.append(
            Telemetry(
                t_ns, mean_duty(state, previous, t_us), (state.left_counts, state.right_counts),
                1e-3 * state.battery_mv, state.mark_count,
                self.clock.host_ns(self.clock.unwrap(state.mark_t_us)) if self.clock.is_synchronised else now_ns,
                self.stop_cause, bool(state.flags & StateFlag.ENCODER_FAULT),
                (1e-3 * state.left_permille, 1e-3 * state.right_permille), state.nonce,
            )
        )  # fmt: skip

    def _count_errors(self, previous: State, current: State) -> None:
        """Add the faults that the Uno counted between two frames of telemetry; its counters wrap at 256."""
        s = self.statistics
        s.rejected_frames += (current.bad_frames - previous.bad_frames) & 0xFF
        s.ignored_frames += (current.ignored_frames - previous.ignored_frames) & 0xFF
        s.overrun_bytes += (current.overruns - previous.overruns) & 0xFF

    def _update_stop_cause(self, state: State, t_ns: int) -> None:
        """Set `stop_cause` from the flags of the telemetry."""
        if state.flags & StateFlag.STOPPED:
            self.stop_cause = stop(StopReason.UNO_LATCHED, "baqueano robot clear HOST")
        elif state.flags & StateFlag.BATTERY_LOW:
            self.stop_cause = stop(StopReason.UNO_BATTERY, battery_v=1e-3 * state.battery_mv)
        elif self._is_armed and state.flags & StateFlag.ARMED:
            self._is_confirmed, self._unarmed_ns = True, None
            if state.flags & StateFlag.DEAD_MAN and self.statistics.sent_commands > 1:
                self.stop_cause = stop(StopReason.UNO_DEAD_MAN, silent_ms=state.drive_age_ms)
        elif self._is_armed and self._is_confirmed:
            self.stop_cause = stop(StopReason.UNO_DISARMED)
        elif self._is_armed and t_ns - self._armed_ns > ARM_DELAY_S * 1e9:
            self._unarmed_ns = t_ns if self._unarmed_ns is None else self._unarmed_ns
            if t_ns - self._unarmed_ns > ARMING_TIMEOUT_S * 1e9:
                self.stop_cause = stop(StopReason.UNO_DEAF, arming_ms=1e3 * ARMING_TIMEOUT_S)
        elif not self._is_armed and self._is_latched:
            self.stop_cause = None


def permille(duty: float) -> int:
    """Return a duty, clipped to [-1, 1], in permille; 0 for a duty that is not finite."""
    return round(1000.0 * max(-1.0, min(1.0, duty))) if math.isfinite(duty) else 0


def mean_duty(state: State, previous: PreviousTelemetry | None, t_us: int) -> tuple[float, float]:
    """Return the mean duty (left, right) since the previous telemetry, or the present duty if `previous` is None."""
    if previous is None or t_us <= previous.t_us:
        return 1e-3 * state.left_permille, 1e-3 * state.right_permille
    ms = max(1, round(1e-3 * (t_us - previous.t_us)))  # the sums count whole milliseconds
    left_duty = count_increase(state.left_sum, previous.state.left_sum) / (1000.0 * ms)
    right_duty = count_increase(state.right_sum, previous.state.right_sum) / (1000.0 * ms)
    return left_duty, right_duty
