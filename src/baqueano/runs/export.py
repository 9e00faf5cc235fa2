"""Export a run as CSV (all signals, one row per tick) or as TUM trajectories (t x y z qx qy qz qw).

A CSV file contains SI units, and times in seconds since the first tick. It has a decimal point, commas between columns,
and all digits of a double. A cell is empty if nothing was measured at this tick, or if the value is not known.
`decimal=","` writes semicolons and decimal commas for a spreadsheet that requires them.
"""

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from baqueano.atomic_file import write_then_appear
from baqueano.errors import FileError, UsageError
from baqueano.signals import seconds

if TYPE_CHECKING:
    from baqueano.runs.run import Run

POSE_COLUMNS, VELOCITY_COLUMNS = ("x_m", "y_m", "psi_rad"), ("nu_x_m_s", "nu_y_m_s", "nu_psi_rad_s")
ACCELERATION_COLUMNS = ("nu_x_dot_m_s2", "nu_y_dot_m_s2", "nu_psi_dot_rad_s2")
PATH_NAMES = ("estimate", "reference", "truth")


def export_csv(run: "Run", path: Path | str, decimal: str = ".") -> Path:
    """Write a run as one table; a value that was measured between two ticks is in the row of the later tick.

    Parameters
    ----------
    run : Run
        The run.
    path : path
        A new file.
    decimal : str
        "." with commas between the columns, or "," with semicolons.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UsageError
        For another decimal mark.
    FileError
        If the file exists.

    Examples
    --------
    >>> run = bq.simulate(bq.load("small"), np.zeros((10, 3)))
    >>> export_csv(run, "ten_ticks.csv").read_text().split(",")[:2]
    ['t_s', 'applied.u_x']
    """
    if decimal not in (".", ","):
        raise UsageError.of("runs.decimal", value=decimal)
    names, columns = zip(*columns_of(run), strict=True)
    rows = np.column_stack(columns)

    def cell(x: float) -> str:
        return "" if math.isnan(x) else repr(x).replace(".", decimal)

    path = _checked_new_path(path)
    with write_then_appear(path) as file, io.TextIOWrapper(file, "utf-8", newline="") as stream:
        writer = csv.writer(stream, delimiter=";" if decimal == "," else ",")
        writer.writerow(names)
        writer.writerows([cell(x) for x in row] for row in rows.tolist())
    return path


def columns_of(run: "Run") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the name and the values (N,) of each column of the table of a run."""
    t_ns = run.t_ns
    yield "t_s", run.t_s
    for stage, values in run.commands.items():
        yield from ((f"{stage}.{name}", values[:, i]) for i, name in enumerate(run.command_names))
    for name, channel in run.sensors.items():
        rows = newest_tick_rows(
            t_ns, channel.arrival_ns, np.column_stack([channel.z, seconds(channel.t_ns, run.start_ns)])
        )
        for i in range(channel.z.shape[1]):
            yield f"{name}[{i}]", rows[:, i]
        yield f"{name}.t_s", rows[:, -1]
    for stage, kinds in (
        ("estimate", (POSE_COLUMNS, VELOCITY_COLUMNS)), ("reference", (POSE_COLUMNS, VELOCITY_COLUMNS)),
        ("truth", (POSE_COLUMNS, VELOCITY_COLUMNS, ACCELERATION_COLUMNS)),
    ):  # fmt: skip
        log = getattr(run, stage)
        if log is not None:
            for column_kind, values in zip(kinds, log[1:], strict=False):
                rows = newest_tick_rows(t_ns, log.t_ns, values)
                yield from ((f"{stage}.{name}", rows[:, i]) for i, name in enumerate(column_kind))
    if run.estimate is not None:
        rows = newest_tick_rows(t_ns, run.estimate.t_ns, run.estimate.cov.reshape(-1, 36))
        for i, name in enumerate(POSE_COLUMNS + VELOCITY_COLUMNS):
            variance = rows[:, 7 * i]
            yield f"estimate.std_{name}", np.sqrt(np.where(variance >= 0.0, variance, np.nan))


def newest_tick_rows(t_ns: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return, for each tick, the newest row of `values` (M, m) since the previous tick: (N, m), NaN without a row."""
    newest_rows = np.searchsorted(times, t_ns, side="right") - 1
    is_new = np.diff(newest_rows, prepend=-1) > 0
    rows = np.full((len(t_ns), values.shape[1]), np.nan)
    rows[is_new] = values[newest_rows[is_new]]
    return rows


def export_tum(run: "Run", path: Path | str, trajectory: str = "estimate") -> Path:
    """Write a trajectory for evo and similar tools: time [s], x and y [m], heading as a quaternion.

    The rest before the drive is excluded, as in `compare`. A heading that is not finite becomes a quaternion of NaN.

    Parameters
    ----------
    run : Run
        The run.
    path : path
        A new file.
    trajectory : str
        "estimate", "reference" or "truth".

    Returns
    -------
    Path
        The file.

    Raises
    ------
    UsageError
        If the run does not have this trajectory.
    FileError
        If the file exists.

    Examples
    --------
    >>> run = bq.simulate(bq.load("small"), np.zeros((10, 3)))
    >>> print(export_tum(run, "truth.tum", "truth").read_text().splitlines()[0])
    # t_s x y z qx qy qz qw
    """
    log = getattr(run.without_rest, trajectory) if trajectory in PATH_NAMES else None
    if log is None:
        names = ", ".join(name for name in PATH_NAMES if getattr(run, name) is not None) or "none"
        raise UsageError.of("runs.no-trajectory", run=run.name, value=trajectory, trajectories=names)
    path = _checked_new_path(path)
    with write_then_appear(path) as file, io.TextIOWrapper(file, "utf-8", newline="\n") as stream:
        stream.write("# t_s x y z qx qy qz qw\n")
        for t_ns, (x, y, psi) in zip(log.t_ns.tolist(), log.eta.tolist(), strict=True):
            t = f"{t_ns // 1_000_000_000}.{t_ns % 1_000_000_000:09d}"
            half = 0.5 * psi if math.isfinite(psi) else math.nan
            stream.write(f"{t} {x!r} {y!r} 0 0 0 {math.sin(half)!r} {math.cos(half)!r}\n")
    return path


def _checked_new_path(path: Path | str) -> Path:
    path = Path(path)
    if path.exists():
        raise FileError.of("runs.file-exists", path=path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
