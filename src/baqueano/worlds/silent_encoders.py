"""Find the encoder that does not count although its motor is driven hard.

The firmware sets a flag if a wheel had at least DRIVEN_HARD of full duty for 0.5 s without a count. One flag serves
both wheels. The counts identify the affected wheel: they did not change for QUIET_S at this duty.
"""

from typing import TYPE_CHECKING

from baqueano.diagnostics import Diagnostic, Severity, note

if TYPE_CHECKING:
    from baqueano.worlds.robot import Telemetry

DRIVEN_HARD = 0.5
QUIET_S = 0.4  # less than the firmware's 0.5 s, as telemetry is not in phase with it
FIX = "baqueano robot settings HOST --encoders none"


class SilentEncoders:
    """A detector of silent encoders in one drive, from telemetry."""

    def __init__(self) -> None:
        self._before: Telemetry | None = None
        self._quiet_ns = [0, 0]  # since when a wheel has been driven hard without a count
        self._reported_wheels: set[int] = set()

    def update(self, now: "Telemetry") -> list[Diagnostic]:
        """Return a warning if one or both encoders became silent. It is repeated only after the firmware has cleared
        its flag.
        """
        before, self._before = self._before, now
        for wheel in range(2):
            is_driven = abs(now.applied[wheel]) >= DRIVEN_HARD
            if before is None or not is_driven or now.counts[wheel] != before.counts[wheel]:
                self._quiet_ns[wheel] = now.t_ns
        if not now.encoder_silent:
            self._reported_wheels.clear()
            return []
        new = {
            w for w in range(2) if (now.t_ns - self._quiet_ns[w]) * 1e-9 >= QUIET_S
        } - self._reported_wheels
        self._reported_wheels |= new
        if len(new) == 2:
            return [note("encoders.both-silent", Severity.WARNING, FIX)]
        return [note(f"encoders.{('left', 'right')[w]}-silent", Severity.WARNING, FIX) for w in new]
