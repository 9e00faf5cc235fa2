"""Connect a drive to the service that executes it: the operator's requests, the clients, and the end."""

from collections.abc import Callable

from baqueano.diagnostics import Diagnostic
from baqueano.door.operator import Operator
from baqueano.drive.observers import EventLine, Observer
from baqueano.errors import FileError
from baqueano.loop import Record

SendEvent = Callable[[str, Diagnostic], None]  # level, event


class MissionObserver(Observer):
    """An observer that stops a drive on the operator's request.

    `stopped` is the reason of the stop, and `record` the last record; both are None before there is one.
    """

    def __init__(self, operator: Operator, send_event: SendEvent, *, attended: bool) -> None:
        self.stopped: Diagnostic | None = None
        self.record: Record | None = None
        self._operator, self._send_event, self._attended = operator, send_event, attended
        self._is_over = False

    def stop_reason(self, t_ns: int) -> Diagnostic | None:
        """Return the operator's reason to stop the vehicle."""
        return self._operator.stop_reason(attended=self._attended)

    def pop_mark_count(self) -> int:
        """Return how often the operator has reported the mark since the last tick."""
        return self._operator.pop_mark_count()

    def on_record(self, record: Record) -> None:
        """Keep the record for the state message."""
        self.record = record

    def on_disk_full(self, reason: Diagnostic) -> None:
        """Report the full disk to the clients."""
        self._send_event("error", reason)

    def end(self, reason: Diagnostic | None) -> list[EventLine]:
        """Keep the reason of the stop."""
        self._is_over, self.stopped = True, reason
        return []

    def watch(self, drive: Callable[[], object]) -> Diagnostic | None:
        """Call `drive`, which has this observer, and return the reason of the stop, None if it was not stopped.

        A run that could not be closed is reported: the drive is over. Raise FileError if the drive did not begin.
        """
        try:
            drive()
        except FileError as error:
            if not self._is_over:
                raise
            self._send_event("error", error.diagnostic)
        return self.stopped
