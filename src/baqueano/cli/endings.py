"""How a command ends: one paragraph on stderr and an exit code.

0 done, 1 the answer is no, 2 usage, 3 a file that cannot be used, 4 robot unreachable, 5 safety stop,
130 Ctrl-C.
"""

import traceback

import click

from baqueano.cli.next_line import sentence, typed, with_next
from baqueano.cli.spelling import as_typed
from baqueano.errors import INTERRUPTED, BaqueanoError, from_outside, in_users_file, named

NO, USAGE, BAD_FILE = 1, 2, 3


class Interrupted(BaqueanoError):
    """Ctrl-C ended a drive; what was recorded is whole."""

    exit_code = INTERRUPTED


def ending(error: BaseException, args: list[str]) -> tuple[str, int]:
    """The paragraph, and the exit code.  args: the command line, without `baqueano`."""
    match error:
        case BaqueanoError():
            text = as_typed(str(error)) if error.exit_code == USAGE else str(error)
            return f"baqueano: {with_next(text, error.exit_code, args)}", error.exit_code
        case click.UsageError():
            path = error.ctx.command_path if error.ctx else "baqueano"
            return f"baqueano: {sentence(error.format_message())} All options: {path} --help", USAGE
        case click.ClickException():
            return f"baqueano: {sentence(error.format_message())}", error.exit_code
        case KeyboardInterrupt() | click.Abort() if from_outside(error) or not in_users_file(error):
            return "baqueano: stopped from the keyboard.", INTERRUPTED
        case MemoryError():
            return f"baqueano: there is not enough memory for this ({error}). Ask for less, in parts.", NO
        case _ if type(error).__name__ == "CompileError":  # of the engine, which need not be loaded here
            return f"baqueano: {sentence(str(error))} Or let Python compute: --backend python", USAGE
        case OSError():
            where = error.filename or "what was to be written"
            why = error.strerror or str(error)
            return (
                f"baqueano: {where}: {sentence(why)} Make room or give another place, then: {typed(args)}",
                BAD_FILE,
            )
    if place := in_users_file(error):  # where no loop guards the block
        ends = "" if isinstance(error, Exception) else " A block may not end the program."
        said = f"{place} raised {sentence(named(error))}{ends}"
        return f"baqueano: {said} When it is mended, again: {typed(args)}", BAD_FILE
    return _unforeseen(error), NO


def _unforeseen(error: BaseException) -> str:
    """An error that no one foresaw is ours, and says where it happened."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{last.filename}, line {last.lineno}"
    return (
        f"baqueano: an error that should not happen: {type(error).__name__}: {sentence(str(error))} "
        f"({where}) Run the same command with --debug and send us what it prints."
    )
