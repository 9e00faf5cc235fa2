"""The command line: one verb, one thin function, imported only when it is called."""

import importlib
import sys
from typing import Any

import click

from baqueano import __version__

VERBS = {
    "demo": "The whole loop on the simulated small vehicle: identify, tune, teach, repeat, report.",
    "new": "Make a project folder: vehicle file, an estimator and a controller of your own, ready to run.",
    "simulate": "Drive one simulated vehicle, or thousands, with a signal; write a run.",
    "experiment": "Drive the vehicle with a signal that excites its dynamics; write a run.",
    "identify": "Fit the model, and the noise, to one or more runs.",
    "tune": "Find the controller's gains on the identified model.",
    "teach": "Drive a path once and store it as a route.",
    "repeat": "Drive a taught route again, for N laps or for ever.",
    "replay": "Send a run through the same blocks again, or through others.",
    "compare": "Errors and consistency of one or more runs.",
    "runs": "List, show, cut, recover, import and export runs.",
    "report": "Write one self-contained HTML page about a run.",
    "study": "Reproduce the paper's case studies; judge by recordings.",
    "blocks": "List the blocks; check one of your own.",
}
INTERRUPTED = 130


class _Verbs(click.Group):
    """Finds a verb in baqueano.cli.<verb>, so that --help imports none of them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in VERBS:
            return None
        return importlib.import_module(f"baqueano.cli.{cmd_name}").command

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if args and args[0] not in VERBS and not args[0].startswith("-"):
            import difflib

            near = difflib.get_close_matches(args[0], VERBS, n=1)
            advice = f"Did you mean '{near[0]}'?" if near else "The verbs are " + ", ".join(VERBS) + "."
            raise click.UsageError(f"There is no verb '{args[0]}'. {advice}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the Python traceback of an error.")
@click.version_option(__version__, prog_name="baqueano")
@click.pass_context
def baqueano(ctx: click.Context, debug: bool) -> None:
    """Identify, estimate, control and guide a small autonomous vehicle.

    \b
    Begin with:  baqueano demo
    Then:        baqueano new mylab
    """
    ctx.obj = debug


def main(args: list[str] | None = None) -> None:
    """The entry point. Every error of ours ends as one paragraph on stderr and its exit code."""
    from baqueano.cli.terminal import plain_letters
    from baqueano.errors import BaqueanoError

    plain_letters(sys.stdout, sys.stderr)
    args = sys.argv[1:] if args is None else args
    debug = "--debug" in args
    args = ["--debug"] * debug + [a for a in args if a != "--debug"]
    try:
        sys.exit(baqueano.main(args, prog_name="baqueano", standalone_mode=False) or 0)
    except BaqueanoError as error:
        if debug:
            raise
        click.echo(f"baqueano: {error}", err=True)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (KeyboardInterrupt, click.Abort):
        click.echo("baqueano: stopped by the keyboard.", err=True)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except Exception as error:
        if debug:
            raise
        click.echo(_unexpected(error), err=True)
        sys.exit(1)


def _unexpected(error: Exception) -> str:
    """One paragraph for an error that no one foresaw: it is ours, and says where it happened."""
    import traceback

    last = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{last.filename}, line {last.lineno}"
    return (
        f"baqueano: an error that should not happen: {type(error).__name__}: {error} ({where}). "
        "Run the same command with --debug and send us what it prints."
    )
