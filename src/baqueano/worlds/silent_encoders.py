"""Find the encoder that does not count although the duty of its motor is large.

The firmware sets a flag if a wheel had at least MIN_DRIVEN_DUTY of full duty for 0.5 s without a count. One flag serves
both wheels. The counts identify the affected wheel: they did not change for MAX_QUIET_S at this duty.
"""

from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, Severity, note

if TYPE_CHECKING:
    from baqueano.worlds.robot import Telemetry

MIN_DRIVEN_DUTY = 0.5
MAX_QUIET_S = 0.4  # less than the firmware's 0.5 s, because telemetry is not in phase with the firmware
FIX = "baqueano robot settings HOST --encoders none"


class SilentEncoders:
    """A detector of silent encoders in one drive, from telemetry."""

    def __init__(self) -> None:
        self._previous: Telemetry | None = None
        self._quiet_ns = [0, 0]  # time from which a wheel has been driven without a count
        self._reported_wheels: set[int] = set()

    def update(self, telemetry: "Telemetry") -> list[Diagnostic]:
        """Return a list with a warning if one or both encoders became silent, else an empty list.

        The warning is repeated only after the firmware has cleared its flag.
        """
        previous, self._previous = self._previous, telemetry
        for wheel in range(2):
            is_driven = abs(telemetry.applied_duty[wheel]) >= MIN_DRIVEN_DUTY
            if previous is None or not is_driven or telemetry.counts[wheel] != previous.counts[wheel]:
                self._quiet_ns[wheel] = telemetry.t_ns
        if not telemetry.encoder_silent:
            self._reported_wheels.clear()
            return []
        new_wheels = {
            w for w in range(2) if (telemetry.t_ns - self._quiet_ns[w]) * 1e-9 >= MAX_QUIET_S
        } - self._reported_wheels
        self._reported_wheels |= new_wheels
        if len(new_wheels) == 2:
            return [note("encoders.both-silent", Severity.WARNING, FIX)]
        return [note(f"encoders.{('left', 'right')[w]}-silent", Severity.WARNING, FIX) for w in new_wheels]
