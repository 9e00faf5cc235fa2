"""Run the command line in this process: it is fast, and exit code and both streams are available separately."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from baqueano.cli import errors, main
from baqueano.diagnostics import Diagnostic


class DriveEnded(NamedTuple):
    """The exit code, the output and the error of a command that has ended."""

    code: int
    out: str
    err: str
    ending: errors.CommandError | None = None

    @property
    def reason(self) -> Diagnostic:
        """Return the diagnostic of the error."""
        assert self.paragraph
        assert self.ending is not None
        return self.ending.reason

    @property
    def cause(self) -> Diagnostic:
        """Return the cause of the error."""
        cause = self.reason.figures["cause"]
        assert isinstance(cause, Diagnostic)
        return cause

    @property
    def fix(self) -> str:
        """Return the command that the error advises."""
        assert self.ending is not None
        reason = self.ending.next or self.reason
        assert reason.fix in self.paragraph
        return reason.fix

    @property
    def paragraph(self) -> str:
        """Return the paragraph of an error, without earlier output."""
        message = self.err[self.err.index("baqueano: ") :]
        assert "Traceback" not in self.err
        assert "\n\n" not in message.strip()
        assert "\nbaqueano: " not in message
        return message.strip()

    @property
    def reply(self) -> dict[str, Any]:
        """Return the JSON object on stdout; stdout must not contain anything else."""
        reply = json.loads(self.out)
        assert set(reply) - {"reasons", "forecast", "findings", "laps"} == {"rows", "verdict"}
        return reply


@pytest.fixture
def baqueano(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> Callable[..., DriveEnded]:
    """Return a function such as `baqueano("runs", "ls")` that runs a command in an empty folder."""
    monkeypatch.chdir(tmp_path)
    endings: list[errors.CommandError] = []

    def keep_error(
        error: BaseException, args: list[str], make_error=errors.command_error
    ) -> errors.CommandError:
        endings.append(make_error(error, args))
        return endings[-1]

    monkeypatch.setattr(errors, "command_error", keep_error)

    def run_line(*args: str) -> DriveEnded:
        capsys.readouterr()
        endings.clear()
        with pytest.raises(SystemExit) as end:
            main(list(args))
        out, err = capsys.readouterr()
        return DriveEnded(int(end.value.code or 0), out, err, *endings)

    return run_line


@pytest.fixture(scope="session")
def lab(tmp_path_factory) -> Path:
    """Return a folder with a run of 3 s and a taught route."""
    folder = tmp_path_factory.mktemp("lab with a space, Núñez")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in (
            "experiment --vehicle small --seconds 3 --json",
            "teach lab --vehicle small --driver circle --size 0.3 --speed 0.4 --json",
        ):
            with pytest.raises(SystemExit) as end:
                main(line.split())
            assert not end.value.code
    return folder
