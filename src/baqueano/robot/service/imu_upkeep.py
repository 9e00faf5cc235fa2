"""Keep the IMU of the service ready between drives: search for it until it answers, and free its bus."""

from collections.abc import Callable
from typing import Any

from baqueano.diagnostics import Diagnostic, StopReason, note, stop
from baqueano.errors import BaqueanoError
from baqueano.robot.imu.bus_recovery import RecoveryOutcome
from baqueano.signals import NANOSECONDS

FIND_PERIOD_S = 5.0  # between two searches for an IMU


class ImuUpkeep:
    """The IMU: `driver` is None without one, and `find` opens an IMU that did not answer at the start.

    Each method reports the same failure only once.
    """

    def __init__(self, driver: Any = None, find: Callable[[], object] | None = None) -> None:
        self.driver: Any = driver
        self.find = find
        self._absence: Diagnostic | None = None  # why the IMU is missing
        self._recovery: RecoveryOutcome | None = None  # the last one, until the next drive
        self._search_ns = -(1 << 62)  # time of the next search

    def begin_drive(self) -> None:
        """Forget the last recovery of the bus."""
        self._recovery = None

    @property
    def bus_message(self) -> Diagnostic | None:
        """Return the outcome of the last recovery of the bus, None without a recovery since the last drive."""
        return self._recovery.message if self._recovery else None

    def is_search_due(self, now_ns: int) -> bool:
        """Return True if the IMU did not answer so far, and the last search is FIND_PERIOD_S ago."""
        return self.driver is None and self.find is not None and now_ns >= self._search_ns

    def search(self, now_ns: Callable[[], int]) -> Diagnostic | None:
        """Search for the IMU, and return a new obstacle or the success, None if the obstacle is still the same.

        The search takes two seconds if a chip answers but does not send samples.
        """
        previous_absence, self._absence = self._absence, None
        try:
            self.driver = self.find() if self.find is not None else None
        except BaqueanoError as error:
            self._absence = stop(StopReason.IMU_ABSENT, cause=error.diagnostic)
        self._search_ns = now_ns() + round(FIND_PERIOD_S * NANOSECONDS)
        return None if self._absence == previous_absence else self._absence or note("imu.answers")

    def free_bus(self) -> Diagnostic | None:
        """Clock a stuck bus free in a second thread, and return a new outcome of a recovery.

        The caller must ensure that no drive is in progress.
        """
        if self.driver is None:
            return None
        outcome = self.driver.free_bus()
        if outcome is not None and (outcome.is_free or outcome != self._recovery):
            self._recovery = outcome
            return outcome.message
        if self._recovery is not None and not self._recovery.is_free and not self.driver.is_silent:
            self._recovery = None
        return None

    def obstacle(self) -> Diagnostic | None:
        """Return the reason why a drive is not allowed to begin without this IMU; None if it is allowed."""
        if self._absence is not None or self.driver is None or not self.driver.is_silent:
            return self._absence
        if not self.driver.is_bus_stuck:
            return stop(StopReason.IMU_SILENT)
        # if the last recovery freed the bus, it is stuck again
        if self._recovery is None or self._recovery.is_free:
            return stop(StopReason.IMU_BUS_BLOCKED)
        return stop(StopReason.IMU_BUS_STILL_BLOCKED, cause=self._recovery.message)
