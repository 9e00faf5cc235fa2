"""List the subcommands; each is imported when it is called, and translated into the current language."""

import importlib
from copy import copy

import click

from baqueano.diagnostics import nearest
from baqueano.messages import language
from baqueano.messages.language import mark as N_, translate as _

SUBCOMMANDS = {
    "demo": "Run the whole loop on the simulated small vehicle: identify, tune, teach, repeat, report.",
    "new": "Make a project folder: vehicle file, blocks of your own and a notebook, ready to run.",
    "simulate": "Simulate one vehicle, or thousands, with a signal; write a run.",
    "experiment": "Drive the vehicle with a signal that excites its dynamics; write a run.",
    "identify": "Fit the model, and the noise, to one or more runs.",
    "tune": "Tune the controller's gains on the identified model.",
    "drive": "Drive manually from this terminal, with keys or a game pad; write a run.",
    "teach": "Drive a path once and store it as a route.",
    "route": (
        "Draw, import, smooth, cut, join, reverse, scale or speed up a route; check it before a drive."
    ),
    "forecast": "Predict, before a drive, the uncertainty of the position along a route.",
    "repeat": "Drive a taught route again, for N laps or for ever.",
    "replay": "Process a run again with the same blocks, or with others.",
    "compare": "Show errors and consistency of one or more runs.",
    "runs": "List, show, cut, recover, import and export runs.",
    "serve": "Open the page of a vehicle in a browser: watch, drive, teach, repeat, stop.",
    "view": "Open a run in a browser: map, time plots, events; compare it with another run.",
    "sweep": "Compare estimators, controllers and guides on the same simulated drives or recorded runs.",
    "report": "Write one self-contained HTML page about a run.",
    "study": "Reproduce the paper's case studies; test with recordings.",
    "robot": "Set up and use a real vehicle: from an empty card to a calibrated vehicle; its service, state and runs.",
    "blocks": "List the blocks; check one of your own.",
}

SUBPACKAGE_VERBS = {  # subpackage → verbs; the other verbs are modules of this package
    "driving": ("drive", "experiment", "repeat", "replay", "route", "teach"),
    "modelling": ("compare", "forecast", "identify", "report", "runs", "simulate", "study", "sweep", "tune"),
    "page": ("serve", "view"),
    "robot": ("robot",),
}

MAX_HELP_LETTERS = 200  # characters; every first sentence is shorter

# names of the values of options
METAVARS = N_("TEXT"), N_("INTEGER"), N_("NUMBER"), N_("FLOAT")
USAGE = (N_("[OPTIONS]"), N_("COMMAND [ARGS]..."))  # of click's first line
MIN_SIMILARITY = 0.65  # letters that a mistyped subcommand has in common with the right name, as a share
BACKENDS = ("auto", "c", "python", "numpy")


def unknown_subcommand_error(verb: str, verbs: list[str], ctx: click.Context) -> Exception:
    """Return the error for an unknown subcommand, with the nearest name."""
    from baqueano.errors import UsageError

    suggestion = nearest(verb, verbs, MIN_SIMILARITY)
    fix = "" if "match" in suggestion.figures else f"{ctx.command_path} --help"
    code = "cli.no-such-verb" if fix else "cli.unknown-verb"
    return UsageError.of(code, fix, path=ctx.command_path, value=verb, suggestion=suggestion)


class SubcommandGroup(click.Group):
    """A group of subcommands."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the typed subcommand. Raise UsageError, with the nearest name, for an unknown subcommand."""
        names = self.list_commands(ctx)
        if args and args[0] not in names and not args[0].startswith("-"):
            raise unknown_subcommand_error(args[0], names, ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the subcommands, each with the complete first sentence of its help."""
        with formatter.section(_("Commands")):
            formatter.write_dl([(name, self.first_sentence(name)) for name in self.list_commands(ctx)])

    def first_sentence(self, name: str) -> str:
        """Return the first sentence of a subcommand's help."""
        return self.commands[name].get_short_help_str(MAX_HELP_LETTERS)


def load_command(verb: str) -> click.Command:
    """Import a subcommand of SUBCOMMANDS, and return its command with help in the current language."""
    subpackage = next(
        (f"{subpackage}." for subpackage, verbs in SUBPACKAGE_VERBS.items() if verb in verbs), ""
    )
    command = importlib.import_module(f"baqueano.cli.{subpackage}{verb}").command
    command._help_option = None  # click caches the help option of the first call
    return translate_command(command)


def translate_command(command: click.Command) -> click.Command:
    """Return a copy of a command, or of a group, with help in the current language."""
    command = copy(command)
    command._help_option = None  # click caches it in the first requested language
    for name in ("help", "short_help", "epilog"):
        setattr(command, name, language.translate(getattr(command, name) or "") or None)
    command.params = [copy(param) for param in command.params]
    for param in command.params:
        if isinstance(param, click.Option):
            param.help = language.translate(param.help or "") or None
            param.metavar = language.shown_placeholders(param.metavar or "") or _metavar(param)
        else:
            param.metavar = language.shown_placeholders(param.make_metavar(click.Context(command)))
    command.options_metavar = language.translate(command.options_metavar or "") or None
    if isinstance(command, click.Group):
        command.subcommand_metavar = language.translate(command.subcommand_metavar)
        command.commands = {name: translate_command(verb) for name, verb in command.commands.items()}
    return command


def _metavar(option: click.Option) -> str | None:
    """Return the name of an option's value in the help; None if the help lists the values."""
    value_type = option.type
    if option.is_flag or option.count or isinstance(value_type, click.Choice):
        return None
    if isinstance(value_type, click.Path):
        return language.translate("FILE" if value_type.file_okay else "FOLDER")
    return language.translate(value_type.name.upper())


class LazySubcommandGroup(SubcommandGroup):
    """A group that imports a subcommand only when it is called, so that --help is fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return list(SUBCOMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command, None for an unknown name."""
        return load_command(cmd_name) if cmd_name in SUBCOMMANDS else None

    def first_sentence(self, name: str) -> str:
        return _(SUBCOMMANDS[name])
