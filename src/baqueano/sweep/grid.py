"""Combine vehicles or runs, blocks, routes and seeds into drives.

All drives are checked before the first one begins.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from baqueano.compare.errors import ALIGNMENTS
from baqueano.contracts.blocks import OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.contracts.names import GAINS_CHOICES
from baqueano.contracts.result import Result
from baqueano.contracts.values import Tree
from baqueano.diagnostics import nearest
from baqueano.drive.replay import recorded_vehicle_file
from baqueano.errors import UsageError
from baqueano.guides.route import Route
from baqueano.runs import Run, read_route
from baqueano.sweep.combination import SweepBlocks, SweepJob, SweepSettings
from baqueano.sweep.drawing import register
from baqueano.sweep.gains import FileText, build_controller, find_gains
from baqueano.sweep.result import SweepCombination, SweepResult
from baqueano.sweep.stored_drives import Resources, run_jobs
from baqueano.sweep.workers import processor_count
from baqueano.vehicle_file import VehicleFile, load
from baqueano.vehicle_file.build import DEFAULT_KINDS

LOOP_ROLES = ("estimator", "controller", "guide")


@checked_call('bq.sweep(robot, routes=route, controllers=["pd", "lqr"])')
def sweep(
    subjects: "VehicleFile | Run | str | Sequence[VehicleFile | Run | str]",
    routes: "Route | str | Sequence[Route | str] | dict[str, Route]" = (),
    *,
    estimators: OwnBlock | Sequence[OwnBlock] | dict[str, OwnBlock] = (),
    controllers: OwnBlock | Sequence[OwnBlock] | dict[str, OwnBlock] = (),
    guides: OwnBlock | Sequence[OwnBlock] | dict[str, OwnBlock] = (),
    seeds: Iterable[int] = (0,),
    reference: str | None = None,
    vehicle: VehicleFile | None = None,
    drives_folder: Path | str | None = None,
    processes: int | None = None,
    cluster: str | None = None,
    advance: Callable[[int], None] | None = None,
    **settings: float | str | tuple[float, float, float],
) -> SweepResult:
    """Drive or replay each combination of blocks under the same conditions, and return the results.

    Parameters
    ----------
    subjects : VehicleFile, Run, str, or sequence of them
        Vehicles, which are simulated as by `repeat`; or recorded runs, for which only estimators can vary.
    routes : Route or str, sequence or dict of them
        The routes of the vehicles. A str is the name of a taught route, or the path of a file. A dict gives names.
    estimators, controllers, guides : str, type or block, or sequence or dict of them
        A kind of the package, "file.py:Class", a class or a block; a dict gives their names. Empty: the block of the
        vehicle file. A controller "pd.toml" is the controller of that vehicle file, with its gains.
    seeds : iterable of int
        Seeds of the noise, the same for each combination.
    reference : str, optional
        Label of the combination with which the others are compared; by default the first.
    vehicle : VehicleFile, optional
        For runs: the vehicle file of the estimators; by default the file in the run.
    drives_folder : path, optional
        A folder in which each finished drive is stored. The same call later resumes from there.
    processes : int, optional
        Number of processes, by default one per processor. Drives with blocks that only this process can import are
        run in this process.
    cluster : str, optional
        Address of a Dask scheduler, instead of processes.
    advance : callable, optional
        A function that is called with the number of drives that have just finished.
    **settings : object
        `laps`; `start` (3,) [m, m, rad] of the vehicle, relative to the route's first pose; `alignment` and
        `interval_s` [s] as in `compare`; `backend`. `gains`: "own" gives a controller "folder/file.py:Class" the
        gains of folder/vehicle.toml, if that file names this class; "vehicle" gives it those of the driven vehicle.

    Returns
    -------
    SweepResult
        The results of each drive and each combination, and their differences.

    Raises
    ------
    UsageError
        For a combination that cannot be driven: vehicles without a route, runs with a controller.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> result = sweep(bq.load("small"), routes=circle(0.3, 0.2), controllers=["kanayama", "lqr"], processes=1)
    >>> [row["combination"] for row in result.combinations()], len(result.drives)
    (['kanayama', 'lqr'], 2)
    """
    subjects = [load(subject) if isinstance(subject, str) else subject for subject in _as_list(subjects)]
    blocks_by_role = {
        role: blocks if isinstance(blocks, dict) else _as_list(blocks)
        for role, blocks in zip(LOOP_ROLES, (estimators, controllers, guides), strict=True)
    }
    sweep_settings = _checked_settings(settings)
    if not isinstance(seeds, Iterable):
        raise UsageError.of("sweep.seeds", value=seeds)
    runs = [subject for subject in subjects if isinstance(subject, Run)]
    if runs and len(runs) == len(subjects):
        jobs = _run_jobs(runs, blocks_by_role, vehicle, sweep_settings, _as_list(routes))
    else:
        jobs = _vehicle_jobs(subjects, blocks_by_role, _name_routes(routes), list(seeds), sweep_settings)
    labels = list(dict.fromkeys(job.combination.label for job in jobs))
    if reference is not None and reference not in labels:
        raise UsageError.of("sweep.reference", value=reference, suggestion=nearest(reference, labels))
    count = processor_count() if processes is None else processes
    drives = run_jobs(
        jobs, Resources(count, cluster, None if drives_folder is None else Path(drives_folder)), advance
    )
    if not drives:
        raise KeyboardInterrupt
    register()
    return SweepResult(tuple(drives), len(jobs), reference or labels[0])


def _as_list(value: Tree) -> list:
    """Return a list: the values if there are several, or the single value."""
    if isinstance(value, str | type | Route | Result | VehicleFile) or not isinstance(value, Iterable):
        return [value]
    return list(value)


def _checked_settings(settings: dict) -> SweepSettings:
    names = ("routes", "estimators", "controllers", "guides", "seeds", "reference", *SweepSettings._fields)
    for name in settings:
        if name not in SweepSettings._fields:
            raise UsageError.of("sweep.setting", call="sweep", value=name, suggestion=nearest(name, names))
    conditions = SweepSettings(**settings)
    if conditions.gains not in GAINS_CHOICES:
        raise UsageError.of("sweep.gains-choice", value=conditions.gains, valid=GAINS_CHOICES)
    if conditions.alignment not in ALIGNMENTS:
        raise UsageError.of("compare.alignment", value=conditions.alignment, valid=ALIGNMENTS)
    if not (conditions.laps >= 1 and conditions.interval_s > 0.0):
        raise UsageError.of("sweep.numbers", laps=conditions.laps, interval_s=conditions.interval_s)
    start = tuple(conditions.start)
    if len(start) != 3 or not np.all(np.isfinite(start)):
        raise UsageError.of("simulate.pose", name="start", value=str(list(start)))
    return conditions._replace(start=tuple(map(float, start)))


def _name_routes(routes: Tree) -> dict[str, Route]:
    """Return the routes by name; a taught route is named by its file. Raise FileError if it does not exist."""
    if not isinstance(routes, dict):
        route_list = _as_list(routes)
        names = [
            Path(route).stem if isinstance(route, str) else f"route {k + 1}"
            for k, route in enumerate(route_list)
        ]
        routes = dict(zip(_labels(names) if len(names) > 1 else [""] * len(names), route_list, strict=True))
    return {name: read_route(route) if isinstance(route, str) else route for name, route in routes.items()}


def _vehicle_jobs(
    files: list,
    blocks_by_role: dict[str, list | dict],
    routes: dict[str, Route],
    seeds: list[int],
    settings: SweepSettings,
) -> list[SweepJob]:
    """Return the jobs of each combination; each block is built once, so a wrong one fails before the first drive.
    Raise UsageError without a vehicle, route or seed, or for an object of another type.
    """
    if not files or not routes or not seeds:
        call, route_count = "bq.sweep(robot, route)", len(routes)
        raise UsageError.of("sweep.nothing", call, vehicles=len(files), routes=route_count, seeds=len(seeds))
    if unsupported_files := [
        vehicle_file for vehicle_file in files if not isinstance(vehicle_file, VehicleFile)
    ]:
        raise UsageError.of("sweep.mixed", value=type(unsupported_files[0]).__name__)
    if unsupported_files := [route for route in routes.values() if not isinstance(route, Route)]:
        raise UsageError.of("sweep.route", value=type(unsupported_files[0]).__name__)
    jobs, names = [], _vehicle_names(files)
    for combination, blocks in _combinations(blocks_by_role, files[0]):
        for name, vehicle_file in zip(names, files, strict=True):
            gains = find_gains(vehicle_file, blocks.controller, settings.gains)
            vehicle_file.estimator(blocks.estimator)
            build_controller(vehicle_file, gains)
            for route_name, route in routes.items():
                vehicle_file.guide(route, blocks.guide)
                for seed in seeds:
                    name_parts = [name if len(files) > 1 else "", route_name, f"seed {seed}"]
                    drive = ", ".join(name_part for name_part in name_parts if name_part)
                    job_blocks = blocks._replace(controller=gains.controller)
                    jobs.append(SweepJob(
                        combination, drive, _file_text(vehicle_file), job_blocks, settings, route, seed,
                        gains=gains, vehicle=name, route_name=route_name,
                    ))  # fmt: skip
    return jobs


def _vehicle_names(files: list[VehicleFile]) -> list[str]:
    """Return the names of the vehicles: of their files without the ending; of equal files, the folder."""
    stems = [Path(vehicle_file.path or vehicle_file.label).stem for vehicle_file in files]
    paths = {vehicle_file.path for vehicle_file in files}
    folders = [vehicle_file.path and vehicle_file.path.absolute().parent.name for vehicle_file in files]
    return _labels([
        folder if folder and stems.count(stem) > 1 and len(paths) > 1 else stem
        for stem, folder in zip(stems, folders, strict=True)
    ])  # fmt: skip


def _run_jobs(
    runs: list[Run],
    blocks_by_role: dict[str, list | dict],
    vehicle: VehicleFile | None,
    settings: SweepSettings,
    routes: list,
) -> list[SweepJob]:
    """Return the jobs of recorded runs.
    Raise UsageError if a controller, guide or route is given: they cannot vary there.
    """
    for values, name in (
        (blocks_by_role["controller"], "controllers"),
        (blocks_by_role["guide"], "guides"),
        (routes, "routes"),
    ):
        if values:
            raise UsageError.of("sweep.of-runs", factor=name)
    files = [vehicle or recorded_vehicle_file(run) for run in runs]
    names, jobs = _labels([run.name for run in runs]), []
    for combination, blocks in _combinations(blocks_by_role, files[0]):
        for name, run, vehicle_file in zip(names, runs, files, strict=True):
            vehicle_file.estimator(blocks.estimator)
            file_text = _file_text(vehicle_file)
            jobs.append(SweepJob(combination, name, file_text, blocks, settings, run=run, vehicle=name))
    return jobs


def _combinations(
    blocks_by_role: dict[str, list | dict], vehicle_file: VehicleFile
) -> list[tuple[SweepCombination, SweepBlocks]]:
    """Return every combination of blocks, each with a label from the names of the blocks that vary."""
    choices = {}
    for role in LOOP_ROLES:
        own_kind = str(vehicle_file.data.get(role, {}).get("kind", DEFAULT_KINDS[role]))
        options = blocks_by_role[role] or [None]
        names = [own_kind if block is None else _name(block) for block in options]
        labelled_blocks = (
            options if isinstance(options, dict) else dict(zip(_labels(names), options, strict=True))
        )
        choices[role] = list(labelled_blocks.items())
    varied_roles = [role for role in LOOP_ROLES if len(choices[role]) > 1] or ["controller"]
    combinations = []
    for combination in product(*choices.values()):
        names, blocks = zip(*combination, strict=True)
        label = " · ".join(name for role, name in zip(LOOP_ROLES, names, strict=True) if role in varied_roles)
        combinations.append((SweepCombination(label, *names), SweepBlocks(*blocks)))
    return combinations


def _name(block: object) -> str:
    """Return the name of a block for display."""
    if isinstance(block, str):
        return block
    return block.__name__ if isinstance(block, type) else type(block).__name__


def _labels(names: list[str]) -> list[str]:
    """Return the names; equal names are numbered."""
    labels: list[str] = []
    for name in names:
        equal_count = sum(label == name or label.startswith(f"{name} #") for label in labels)
        labels.append(f"{name} #{equal_count + 1}" if equal_count else name)
    return labels


def _file_text(vehicle_file: VehicleFile) -> FileText:
    return FileText(vehicle_file.text, vehicle_file.label, vehicle_file.path, vehicle_file.on_disk)
