"""What baqueano says when it stops: one paragraph with what was wrong, the value, what was expected, what to do.

The exit code of the command line is part of the error: 1 the answer is no, 2 usage, 3 bad file, 4 robot
unreachable, 5 safety stop, 130 Ctrl-C.
"""

INTERRUPTED = 130  # Ctrl-C, as shells have it


class BaqueanoError(Exception):
    """An end that was foreseen. Its text is for the reader; the command line shows no traceback."""

    exit_code = 1


class AnswerNo(BaqueanoError):
    """All went well, and the answer is no."""

    exit_code = 1


class UsageError(BaqueanoError):
    """What was asked for makes no sense."""

    exit_code = 2


class FileError(BaqueanoError):
    """A file that cannot be used as it is."""

    exit_code = 3


class RobotUnreachable(BaqueanoError):
    """The robot does not answer."""

    exit_code = 4


class SafetyStop(BaqueanoError):
    """The motors were stopped."""

    exit_code = 5


def of_code(code: int, why: str, otherwise: type[BaqueanoError] = BaqueanoError) -> BaqueanoError:
    """The error that ended with this exit code at the other end of a line; `otherwise` where none of ours does."""
    kinds = (AnswerNo, UsageError, FileError, RobotUnreachable, SafetyStop)
    return {kind.exit_code: kind for kind in kinds}.get(code, otherwise)(why)
