"""Define `baqueano compare`: show errors and consistency of runs."""

import click

from baqueano.cli import numbers, options
from baqueano.cli.next_command import advise_to_fit, run_options
from baqueano.cli.report_files import ReportFiles, report_options
from baqueano.cli.terminal import print_answer, print_message, show_activity
from baqueano.diagnostics import note
from baqueano.messages.printable import baqueano_command


@click.command(help="Show errors and consistency of one or more RUNS: by number, name, path, or 'last'.")
@click.argument("runs", nargs=-1, required=True)
@options.align
@click.option(
    "--skip", "skip_s", type=numbers.time_s, default=0.0, help=("Time to exclude at the start [s].")
)
@options.runs_folder
@report_options
@options.as_json
def command(
    runs: tuple[str, ...], align: str, skip_s: float, folder: str, report: ReportFiles, as_json: bool
) -> None:
    from baqueano.compare import compare

    with show_activity(note("cli.compare"), is_delayed=True):
        loaded_runs = options.find_runs(runs, folder)
        comparison = compare(loaded_runs, alignment=align, skip_s=skip_s)
    print_answer(comparison, as_json, laps=comparison.laps())
    advise_to_fit(comparison, loaded_runs, folder)
    if (unestimated_runs := [run for run in loaded_runs if run.estimate is None]) and not as_json:
        name = unestimated_runs[0].path or unestimated_runs[0].name
        replay_options = run_options(folder, unestimated_runs[0], is_in_run=True)
        print_message(
            note(
                "cli.no-estimate",
                fix=baqueano_command("replay", name, *replay_options),
                run=unestimated_runs[0].name,
            )
        )
    report.write_page(comparison)
