"""baqueano study."""

from pathlib import Path

import click

from baqueano.cli import options
from baqueano.cli.terminal import answer, talk


@click.group(help="Reproduce the paper's case studies; judge by recordings.")
def command() -> None: ...


@command.command("paper", help="Case study I: the paper's table, its errors and ours, both models, both figures.")
@options.seed
@click.option("--seeds", default=1, show_default=True, help="Fits at so many seeds from --seed on.")
@options.backend
@options.page
@options.as_json
def paper(seed: int, seeds: int, backend: str, page: Path | None, as_json: bool) -> None:
    from baqueano.study import two_models
    from baqueano.study.paper import Implied, case_study, recorded
    from baqueano.study.paper_page import page_of_paper

    found = case_study(seed, seeds, backend)
    answer(found, as_json)
    models = two_models.two_models(found.fits[0], recorded(seed, backend)[1], recorded(seed + 1_000, backend)[1], backend)
    if not as_json:
        click.echo(f"\n{two_models.table(models)}\n\n{Implied().table()}")
    talk(f"report: {page_of_paper(found, models, backend).save(page or Path('study-paper.html'))}")
