"""Convert the end of a mission, even an error of its blocks, to the reason of the stop and an exit code."""

from collections.abc import Callable

from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.errors import (
    BaqueanoError,
    DiagnosticError,
    UsageError,
    error_text,
    is_interruption,
    user_code_place,
)


def mission_outcome(drive: Callable[[], Diagnostic | None]) -> tuple[Diagnostic | None, int]:
    """Call `drive`, and return the reason for which the drive ended and its exit code.

    sys.exit() in a block, outside the guards of the loop, ends its mission and not the service.
    """
    try:
        return drive(), 0
    except BaqueanoError as error:
        return error.diagnostic, error.exit_code
    except BaseException as error:
        if is_interruption(error):
            raise
        if location := user_code_place(error):
            return note("block.raised-outside", Severity.ERROR, place=location, error=error_text(error)), 1
        if isinstance(error, DiagnosticError):
            return error.diagnostic, UsageError.exit_code
        return note("service.unexpected-error", Severity.ERROR, error=error_text(error)), 1
