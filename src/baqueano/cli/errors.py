"""End a command with one paragraph on stderr and an exit code.

0 done, 1 the answer is no, 2 wrong usage, 3 a file that cannot be used, 4 robot unreachable, 5 safety stop, 130 Ctrl-C.
"""

import traceback
from typing import NamedTuple

import click

from baqueano.cli.next_command import GROUPS, next_command
from baqueano.cli.subcommands import SUBCOMMANDS, load_command
from baqueano.diagnostics import Diagnostic, fault
from baqueano.errors import (
    INTERRUPTED,
    BaqueanoError,
    DiagnosticError,
    MissingMethod,
    error_cause,
    error_text,
    is_interruption,
    user_code_place,
)
from baqueano.messages import text
from baqueano.messages.language import current_language, use_language
from baqueano.messages.printable import baqueano_command

NEGATIVE_ANSWER, USAGE, BAD_FILE = 1, 2, 3


class CommandError(NamedTuple):
    """The reason why a command ended, the command to type next, and the exit code."""

    reason: Diagnostic
    next: Diagnostic | None
    code: int

    @property
    def sentence(self) -> str:
        """Return the reason and the command to type next, in one paragraph."""
        texts = (text(diagnostic) for diagnostic in (self.reason, self.next) if diagnostic is not None)
        return (". " if self.reason.fix else " ").join(texts)

    @property
    def paragraph(self) -> str:
        """Return the error as a paragraph for stderr."""
        return f"baqueano: {self.sentence}"

    def to_json(self) -> dict[str, object]:
        """Return the error for --json: code, values, text, the command to type next, and the exit code."""
        next_entry = {} if self.next is None else {"next": self.next.to_json()}
        return self.reason.to_json() | {"text": self.sentence} | next_entry | {"exit_code": self.code}


def command_error(error: BaseException, args: list[str]) -> CommandError:
    """Return reason, next command and exit code for an error. `args`: the command line, without `baqueano`."""
    diagnostic, code = _diagnosis(error, args)
    return CommandError(diagnostic, next_command(diagnostic, code, args), code)


def _diagnosis(error: BaseException, args: list[str]) -> tuple[Diagnostic, int]:
    match error:
        case BaqueanoError():
            plain_diagnostic = fault("cli.text", words=str(error))
            return (
                error.message if isinstance(error.message, Diagnostic) else plain_diagnostic
            ), error.exit_code
        case click.UsageError():
            return _usage_diagnostic(error, args), USAGE
        case click.ClickException():
            return fault("cli.text", words=error.format_message()), error.exit_code
        case KeyboardInterrupt() | click.Abort() if is_interruption(error) or not user_code_place(error):
            return fault("cli.interrupted"), INTERRUPTED
        case MissingMethod():
            return error.diagnostic, BAD_FILE
        case MemoryError():
            return fault("cli.memory", error=str(error)), NEGATIVE_ANSWER
        case _ if type(error).__name__ == "CompileError":  # of the engine, which is not imported here
            return fault("cli.not-compiled", "--backend python", error=error_cause(error)), USAGE
        case OSError():
            location = fault("cli.output") if error.filename is None else error.filename
            return fault(
                "cli.system", baqueano_command(*args), place=location, error=error.strerror or str(error)
            ), BAD_FILE
    if location := user_code_place(error):  # outside the guards of the loop
        suffix = "" if isinstance(error, Exception) else "-and-ended"
        if isinstance(error, DiagnosticError):  # of the engine: its cause is the error of the block
            error = error.__cause__ or error
        return fault(f"cli.block-raised{suffix}", place=location, error=error_text(error)), BAD_FILE
    last_frame = traceback.extract_tb(error.__traceback__)[-1]
    return fault(
        "cli.unexpected-error", error=error_text(error), file=last_frame.filename, line=last_frame.lineno
    ), NEGATIVE_ANSWER


def _usage_diagnostic(error: click.UsageError, args: list[str]) -> Diagnostic:
    """Return the diagnostic of a command line that click does not accept."""
    if vehicle := _misplaced_vehicle(error, args):
        k = args.index(vehicle)
        fix = baqueano_command(*args[:k], "--vehicle", *args[k:])
        return fault("cli.vehicle-argument", fix, value=vehicle)
    code = "cli.usage"
    if isinstance(error, click.NoSuchOption):
        if corrected_args := _with_option_after_verb(error, args):
            fix = baqueano_command(*corrected_args)
            return fault("cli.option-before-verb", fix, option=error.option_name)
        code = "cli.no-such-option"
        vars(error)["possibilities"] = error.possibilities or _options_by_help(error)
    verb = args[: 2 if args[:1] in GROUPS else 1]
    path = error.ctx.command_path if error.ctx else " ".join(["baqueano", *verb])
    words = " ".join(error.format_message().split()).rstrip(".")
    return fault(code, f"{path} --help", words=words)


def _with_option_after_verb(error: click.NoSuchOption, args: list[str]) -> list[str]:
    """Return the command with the options before a verb moved to its end; [] if the verb lacks the unknown option."""
    ctx = error.ctx
    if ctx is None or not isinstance(group := ctx.command, click.Group):
        return []
    depth, subcommands = len(ctx.command_path.split()) - 1, group.list_commands(ctx)
    k = next((k for k, arg in enumerate(args) if k >= depth and arg in subcommands), None)
    command = None if k is None else group.get_command(ctx, args[k])
    if k is not None and isinstance(command, click.Group) and args[k + 1 : k + 2]:
        command = command.get_command(ctx, args[k + 1])
    is_option = command is not None and any(error.option_name in param.opts for param in command.params)
    return [*args[:depth], *args[k:], *args[depth:k]] if is_option else []


def _options_by_help(error: click.NoSuchOption) -> list[str]:
    """Return the options of this command whose help begins with the unknown name: --duration is --seconds."""
    _, verb, *subcommands = [*(error.ctx.command_path.split() if error.ctx else []), "", ""]
    if verb not in SUBCOMMANDS:
        return []
    name = error.option_name.lstrip("-").lower()
    commands = []
    for language in {"en", current_language()}:
        with use_language(language):
            command = load_command(verb)
            commands.append(
                command.commands[subcommands[0]]
                if isinstance(command, click.Group) and subcommands[0] in command.commands
                else command
            )
    options = [p for command in commands for p in command.params if isinstance(p, click.Option)]
    first_words = ((option.opts[-1], (option.help or "").partition(" ")[0]) for option in options)
    return sorted({option for option, word in first_words if word.strip(".,:;").lower() == name})


def _misplaced_vehicle(error: click.UsageError, args: list[str]) -> str:
    """Return the vehicle file, or the name of the garage, that a command with --vehicle got as an argument; else ""."""
    from baqueano.vehicle_file.garage import names

    ctx = error.ctx
    if ctx is None or all(parameter.name != "vehicle" for parameter in ctx.command.params):
        return ""
    try:
        options, surplus, _ = ctx.command.make_parser(ctx).parse_args(args[2 if args[0] in GROUPS else 1 :])
    except click.UsageError:
        return ""
    is_vehicle = len(surplus) == 1 and (surplus[0].endswith(".toml") or surplus[0] in names())
    return surplus[0] if is_vehicle and not options.get("vehicle") else ""
