"""Run drives in processes or on a cluster. Each finished drive is stored, and a stored drive is read instead of
repeated.

The file name is the digest of all inputs of a row: version, columns, vehicle file, route or run, blocks, seed and
settings. A block of the user is included with its source text, even if only the vehicle file names it. JSON stores
doubles exactly, so a stored drive equals the original.
"""

import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baqueano import __version__
from baqueano.atomic_file import replace_file
from baqueano.block_checks.source_text import is_in_package, source_text
from baqueano.blocks import LOOP_ROLES, PROGRAM, resolve
from baqueano.contracts import optional
from baqueano.errors import USER_MODULE_PREFIX, UsageError
from baqueano.runs.initial_pose import initial_pose
from baqueano.sweep.combination import SweepJob, drive_from_row, drive_job, drive_row
from baqueano.sweep.error_segments import ErrorSegments
from baqueano.sweep.gains import FileText
from baqueano.sweep.result import SweepDrive
from baqueano.sweep.workers import run_in_processes


class Resources(NamedTuple):
    """The processes, the cluster and the folder of a sweep."""

    processes: int = 1
    cluster: str | None = None  # address of a Dask scheduler
    drives_folder: Path | None = None  # a folder


def run_jobs(
    jobs: Sequence[SweepJob], resources: Resources, advance: Callable[[int], None] | None
) -> list[SweepDrive]:
    """Run all jobs, or read their stored drives, and return the drives in order; after Ctrl-C, return only the
    finished drives.
    """
    if resources.drives_folder is not None:
        resources.drives_folder.mkdir(parents=True, exist_ok=True)
    names = [""] * len(jobs)
    if resources.drives_folder is not None:
        texts = {file_text: _named_block_texts(file_text) for file_text in {job.file_text for job in jobs}}
        names = [job_digest(job, texts[job.file_text]) for job in jobs]
    advance, rows = advance or (lambda n: None), {}
    for k, name in enumerate(names):
        if (
            resources.drives_folder is not None
            and (row := _stored_row(resources.drives_folder / f"{name}.json")) is not None
        ):
            rows[k] = row
            advance(1)
    remaining_jobs = [NumberedJob(k, job) for k, job in enumerate(jobs) if k not in rows]
    task = partial(
        _run_and_store,
        drives_folder=resources.drives_folder,
        names={job.number: names[job.number] for job in remaining_jobs},
    )
    if resources.cluster is not None and remaining_jobs:
        results = run_on_cluster(remaining_jobs, resources, names, advance)
    else:
        results = run_in_processes(
            task, remaining_jobs, resources.processes if _can_be_sent(remaining_jobs) else 1, advance
        )
    rows |= dict(results)
    return [drive_from_row(jobs[k], rows[k]) for k in sorted(rows)]


class NumberedJob(NamedTuple):
    """A job with its number in the order."""

    number: int
    job: SweepJob


def _run_and_store(job: NumberedJob, drives_folder: Path | None, names: dict[int, str]) -> tuple[int, dict]:
    """Run a job, write its row to `drives_folder`, and return its number and row."""
    row = drive_row(drive_job(job.job))
    if drives_folder is not None:
        replace_file(drives_folder / f"{names[job.number]}.json", json.dumps(row))
    return job.number, row


def _stored_row(path: Path) -> dict | None:
    """Return the row of a stored drive; None if it does not exist or is incomplete."""
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return row if isinstance(row, dict) and {"figures", "pieces", "stop_reason"} <= row.keys() else None


def _can_be_sent(jobs: Sequence[NumberedJob]) -> bool:
    """Return True if another process can import the blocks: not those of a notebook cell, or of a loaded user file."""
    blocks = {block for job in jobs for block in job.job.blocks if not isinstance(block, str | None)}
    classes = {b if isinstance(b, type) else type(b) for b in blocks}
    if any(block_class.__module__.startswith(USER_MODULE_PREFIX) for block_class in classes):
        return False
    classes |= {type(text.parse().vehicle) for text in {job.job.file_text for job in jobs}}
    if any(block_class.__module__ in (PROGRAM, "builtins") for block_class in classes):
        return False
    try:
        ForkingPickler.dumps(list(blocks))
    except Exception:  # a user's block can raise any error here
        return False
    return True


def job_digest(job: SweepJob, texts_in_file: dict[str, str]) -> str:
    """Return the digest under which the drive of a job is stored; the texts are those of `_named_block_texts`."""
    import hashlib

    parts = [
        __version__,
        *ErrorSegments._fields,
        job.file_text.text,
        repr(job.settings),
        str(job.seed),
        job.drive,
        "" if job.gains.file is None else job.gains.file.text,
    ]
    replaced_blocks = {role: block for role, block in job.blocks._asdict().items() if block is not None}
    parts += [_block_text(role, block, job) for role, block in job.blocks._asdict().items()]
    parts += [text for role, text in texts_in_file.items() if role not in replaced_blocks]
    hasher = hashlib.sha256("\0".join(parts).encode())
    for part in _arrays(job):
        hasher.update(np.ascontiguousarray(part).tobytes())
    return hasher.hexdigest()[:24]


def _arrays(job: SweepJob) -> list[np.ndarray]:
    if job.run is not None:
        channels = [part for channel in job.run.sensors.values() for part in channel]
        truth = [] if job.run.truth is None else [job.run.truth.t_ns, job.run.truth.eta]
        return [job.run.t_ns, job.run.applied_commands, initial_pose(job.run), *channels, *truth]
    return [] if job.route is None else list(map(np.asarray, job.route))


def _block_text(role: str, block: object, job: SweepJob) -> str:
    """Return a block as text: its kind or parameters, with its source text if it is the user's; "" for None."""
    if block is None:
        return ""
    if isinstance(block, str):
        folder = None if job.file_text.path is None else job.file_text.path.parent
        kind, numbers = resolve(role, block, folder), block
    else:
        kind = block if isinstance(block, type) else type(block)
        # all entries of an array, with all digits
        with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
            numbers = kind.__qualname__ if isinstance(block, type) else repr(block)
    return numbers if is_in_package(kind) else f"{numbers}\n{source_text(kind)}"


def _named_block_texts(file_text: FileText) -> dict[str, str]:
    """Return, by role, the source text of each block of the user that the vehicle file itself names."""
    vehicle_file = file_text.parse()
    classes = {role: vehicle_file.kind(role) for role in LOOP_ROLES}
    parts = {"vehicle": vehicle_file.vehicle, **vehicle_file.sensors._asdict()}
    classes |= {
        f"{role} {k}": type(part)
        for role, block in parts.items()
        for k, part in enumerate(optional.nested_blocks(block))
    }
    return {role: source_text(kind) for role, kind in classes.items() if not is_in_package(kind)}


def run_on_cluster(
    jobs: Sequence[NumberedJob], resources: Resources, names: Sequence[str], advance: Callable[[int], None]
) -> list[tuple[int, dict]]:
    """Return the rows of the jobs from the workers of a Dask scheduler. The rows are stored on this computer.
    Raise UsageError if the scheduler does not answer.
    """
    try:
        from distributed import Client, as_completed  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise UsageError.of("sweep.no-distributed", "pip install distributed") from error
    try:
        client = Client(resources.cluster, timeout="10s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError.of("sweep.no-cluster", address=resources.cluster, cause=error) from error
    results: list[tuple[int, dict]] = []
    with client:
        waiting = [
            client.submit(_run_and_store, job, drives_folder=None, names={}, pure=False) for job in jobs
        ]
        try:
            for future in as_completed(waiting, loop=client.loop):
                k, row = future.result()
                if resources.drives_folder is not None:
                    replace_file(resources.drives_folder / f"{names[k]}.json", json.dumps(row))
                results.append((k, row))
                advance(1)
        except KeyboardInterrupt:
            client.cancel(waiting)
    return results
