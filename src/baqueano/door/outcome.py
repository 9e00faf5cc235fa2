"""Return the end of a mission as data, after any error of its blocks: the reason of the stop, and the exit code."""

from collections.abc import Callable

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import BaqueanoError, from_outside, in_users_file, named


def outcome_of(drive: Callable[[], Diagnostic | None]) -> tuple[Diagnostic | None, int]:
    """Return the reason for which the drive ended, and its exit code.

    sys.exit() in a block, outside the guards of the loop, ends its mission and not the service.
    """
    try:
        return drive(), 0
    except BaqueanoError as error:
        return error.diagnostic, error.exit_code
    except BaseException as error:
        if from_outside(error):
            raise
        if place := in_users_file(error):
            return note("block.raised-outside", Severity.ERROR, place=place, error=named(error)), 1
        return note("service.unforeseen", Severity.ERROR, error=named(error)), 1
