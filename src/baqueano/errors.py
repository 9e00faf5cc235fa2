"""Define the errors of baqueano, each one paragraph: the fault, the value, the expected value, and the next step.

Each error has an exit code of the command line: 1 the answer is no, 2 usage, 3 bad file, 4 robot unreachable, 5 safety
stop, 130 Ctrl-C.
"""

import linecache
import sys
import traceback
from opcode import opmap
from pathlib import Path
from typing import Self, cast

from baqueano.diagnostics import Diagnostic, Severity, fault
from baqueano.messages import text
from baqueano.messages.language import translate as _

HIDDEN_MODULES = {"baqueano", "IPython", "ipykernel", "numpy", *sys.stdlib_module_names}  # not of the user
INTERRUPTED = 130  # Ctrl-C, as shells have it
USER_MODULE_PREFIX = "baqueano_user_"  # beginning of the name of a module with the user's blocks
GENERATED_CODE = "<string>"  # file name of the methods that dataclasses generate


class DiagnosticError(Exception):
    """An exception with a diagnostic. The text of the exception is for the reader.

    `message` is a diagnostic, or a text from other code. `diagnostic` is for programs; by default `message`.
    """

    def __init__(self, message: Diagnostic | str = "", diagnostic: Diagnostic | None = None) -> None:
        super().__init__(text(message))
        self.message = message
        self._diagnostic = diagnostic or (message if isinstance(message, Diagnostic) else None)

    @classmethod
    def of(cls, code: str, fix: str = "", subject: str = "", **figures: object) -> Self:
        """Return the error with the diagnostic `fault(code, fix, subject, **figures)`."""
        return cls(fault(code, fix, subject, **figures))

    def _render_traceback_(self) -> list[str]:
        """Return the lines that a notebook shows: the lines of the user's code, and the message."""
        frames, error = [], cast("BaseException | None", self)
        while error is not None:
            for frame, line in traceback.walk_tb(error.__traceback__):
                if str(frame.f_globals.get("__name__", "")).partition(".")[0] not in HIDDEN_MODULES:
                    file = frame.f_code.co_filename
                    name = cell_name(file) or Path(file).name
                    place = _("{file} line {line}", file=name, line=str(line))
                    frames.append(f"{place}: {linecache.getline(file, line).strip()}")
            error = error.__cause__
        return [*frames, f"{type(self).__name__}: {self}"]

    @property
    def diagnostic(self) -> Diagnostic:
        """Return the diagnostic; for a text its code is "error." and the name of the error's class."""
        if self._diagnostic is not None:
            return self._diagnostic
        return Diagnostic(f"error.{type(self).__name__}", Severity.ERROR, "error", {"words": str(self)})


class Invalid(DiagnosticError, ValueError):
    """The error of a value, name or shape that a block or function of the package does not accept."""


class Misuse(DiagnosticError, TypeError):
    """The error of a call, or of a type of argument, that a function of the package does not accept."""


class NoAttribute(DiagnosticError, AttributeError):
    """The error of an attribute that an object lacks."""


class MissingMethod(DiagnosticError, NotImplementedError):
    """The error of a base class whose subclass lacks a method, or whose method returns something else."""


class BaqueanoError(DiagnosticError):
    """An expected error; the command line shows no traceback."""

    exit_code = 1


class AnswerNo(BaqueanoError):
    """The error of a task that ran correctly and whose answer is no."""

    exit_code = 1


class UsageError(BaqueanoError):
    """The error of a request that is not valid."""

    exit_code = 2


class FileError(BaqueanoError):
    """The error of a file that cannot be used."""

    exit_code = 3


class RobotUnreachable(BaqueanoError):
    """The error of a robot that does not answer."""

    exit_code = 4


class SafetyStop(BaqueanoError):
    """The error of motors that were stopped for safety."""

    exit_code = 5


class Interruption(BaqueanoError):
    """The error of a task that Ctrl-C ended; its results are complete up to that time."""

    exit_code = INTERRUPTED


class ExternalError(BaseException):
    """An exception inside a block that is not a fault of the block: an alarm, the end of a manual drive."""


def is_interruption(error: BaseException) -> bool:
    """Return True for an interruption from outside: ExternalError, or Ctrl-C.

    Ctrl-C arrives between two instructions. A KeyboardInterrupt from a `raise` in the code is an error of the code, as
    are SystemExit and GeneratorExit. A guard of a block catches every error except interruptions from outside.
    """
    if not isinstance(error, KeyboardInterrupt):
        return isinstance(error, ExternalError)
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    is_raised_in_code = (
        trace is not None and trace.tb_frame.f_code.co_code[trace.tb_lasti] == opmap["RAISE_VARARGS"]
    )
    return isinstance(error, ExternalError) or not is_raised_in_code


def error_cause(error: BaseException) -> Diagnostic | str:
    """Return an error as a figure of another diagnostic: its diagnostic, or its text."""
    return (
        error.diagnostic
        if isinstance(error, DiagnosticError) and error._diagnostic is not None
        else str(error)
    )


def error_text(error: BaseException) -> str:
    """Return the kind of an error and its text: "ZeroDivisionError: division by zero", "SystemExit".

    The text of an attribute that a signal lacks also contains the attributes that it has.
    """
    try:
        words = "" if error.args == (None,) else str(error)
    except Exception:  # `__str__` can be code of the user
        words = ""
    fields = getattr(getattr(error, "obj", None), "_fields", ())
    if fields and isinstance(error, AttributeError):
        words = _("{error} (it has {names})", error=words, names=", ".join(fields))
    return f"{type(error).__name__}: {words}".removesuffix(": ")


def cell_name(file: str) -> str:
    """Return the name of the notebook's cell whose code has this file name, such as "In[3]"; "" for any other file."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    format_name = getattr(getattr(shell, "compile", None), "format_code_name", lambda name: None)
    return (format_name(file) or ("", ""))[1]


def user_code_place(error: BaseException) -> str:
    """Return the file and line of the last frame in the user's code, such as "mine.py line 12", or "" without one.

    It can be a frame of the cause of the error: an error in a block that is compiled has another class.

    >>> user_code_place(ValueError("raised by nobody"))
    ''
    """
    frames = [
        (f.f_globals.get("__name__", ""), f.f_code, n) for f, n in traceback.walk_tb(error.__traceback__)
    ]
    user_frames = [
        (code.co_filename, line)
        for module, code, line in frames
        if str(module).startswith(USER_MODULE_PREFIX) and code.co_filename != GENERATED_CODE
    ]
    if not user_frames:
        return "" if error.__cause__ is None else user_code_place(error.__cause__)
    file, line = user_frames[-1]
    return _("{file} line {line}", file=Path(file).name, line=str(line))


def exit_code_error(
    code: int, reason: Diagnostic | str, default_class: type[BaqueanoError] = BaqueanoError
) -> BaqueanoError:
    """Return the error for the exit code of a remote command; a `default_class` for an unknown code."""
    error_classes = (AnswerNo, UsageError, FileError, RobotUnreachable, SafetyStop)
    return {error_class.exit_code: error_class for error_class in error_classes}.get(code, default_class)(
        reason
    )
