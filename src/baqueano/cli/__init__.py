"""Define the command line: each subcommand is a short function, which is imported only when it is called."""

import importlib
import os
import sys
import warnings
from copy import copy

import click

from baqueano import __version__
from baqueano.cli.subcommands import BACKENDS, LazySubcommandGroup, translate_command
from baqueano.messages import language
from baqueano.messages.language import mark as N_, translate as _
from baqueano.messages.notation import COMMAND_LINE, use_notation


@click.group(cls=LazySubcommandGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the Python traceback of an error.")
@click.option(
    "--lang",
    type=click.Choice(tuple(language.LANGUAGES)),
    expose_value=False,
    help="Language of messages and help; default: BAQUEANO_LANG, else the locale.",
)
@click.option(
    "--allow-blocks",
    is_flag=True,
    help="Execute blocks that are named in a run, or in a vehicle file of another folder.",
)
@click.version_option(__version__, prog_name="baqueano")
@click.pass_context
def baqueano(ctx: click.Context, debug: bool, allow_blocks: bool) -> None:
    """Identify, estimate, control and guide a small autonomous vehicle.

    \b
    Begin with:  baqueano demo
    Then:        baqueano new mylab
    """
    ctx.obj = debug
    if allow_blocks:
        from baqueano.blocks import permit_blocks

        ctx.with_resource(permit_blocks())
    for variable, choices in (
        ("BAQUEANO_BACKEND", BACKENDS),
        (language.LANGUAGE_VARIABLE, tuple(language.LANGUAGES)),
    ):
        setting = os.environ.get(variable) or choices[0]
        if setting not in choices:
            from baqueano.diagnostics import fault
            from baqueano.errors import UsageError

            unset = f"unset {variable}"
            raise UsageError.of("cli.unknown-setting", unset, variable=variable, value=setting, valid=choices)


def main(args: list[str] | None = None) -> None:
    """Run the command line. An error ends it with one paragraph on stderr and an exit code."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for small matrices, its threads mostly wait
    from baqueano.cli.terminal import replace_unprintable_letters

    replace_unprintable_letters(sys.stdout, sys.stderr)
    args = sys.argv[1:] if args is None else args
    debug = "--debug" in args
    global_flags = [flag for flag in ("--debug", "--allow-blocks") if flag in args]
    args = [arg for arg in args if arg not in global_flags]
    args, tag = _split_language(args)
    language.choose_language(tag if tag in language.LANGUAGES else "")
    with warnings.catch_warnings(), use_notation(COMMAND_LINE):
        if not debug and not sys.warnoptions:  # an overflow during a search does not concern the user
            warnings.simplefilter("ignore", RuntimeWarning)
        sys.exit(_exit_code(args, global_flags + ["--lang", tag] * bool(tag)))


def _split_language(args: list[str]) -> tuple[list[str], str]:
    """Return the arguments without `--lang`, and its value. The option can be at any position before `--`."""
    end = args.index("--") if "--" in args else len(args)
    for k, arg in enumerate(args[:end]):
        if arg == "--lang" and k + 1 < end:
            return args[:k] + args[k + 2 :], args[k + 1]
        if arg.startswith("--lang="):
            return args[:k] + args[k + 1 :], arg.removeprefix("--lang=")
    return args, ""


def _exit_code(args: list[str], leading_args: list[str]) -> int:
    """Run the command, print its error, if any, and return the exit code."""
    from click.exceptions import NoArgsIsHelpError

    from baqueano.cli.terminal import print_message, print_result, printed_objects

    printed_objects.clear()
    try:
        code = translate_command(baqueano).main(
            leading_args + args, prog_name="baqueano", standalone_mode=False
        )
        return code if isinstance(code, int) else 0
    except NoArgsIsHelpError as error:
        error.show()
        return error.exit_code
    except BaseException as error:
        import json
        import traceback

        from baqueano.cli.errors import command_error
        from baqueano.errors import user_code_place

        if isinstance(error, SystemExit) and not user_code_place(error):
            raise
        if isinstance(error, click.Abort) and isinstance(error.__cause__, KeyboardInterrupt):
            error = error.__cause__  # click converts each EOFError and KeyboardInterrupt
        if "--debug" in leading_args:
            print_message("".join(traceback.format_exception(error)).rstrip("\n"))
        failure = command_error(error, args)
        print_message(failure.paragraph)
        if "--json" in args and not printed_objects:
            print_result(json.dumps(failure.to_json(), allow_nan=False))
        return failure.code
