"""`baqueano study marks`: fifty laps over two tags on the floor, by an IMU and an identified model.

Robots of the independent truth (corridor/vehicles.py: gyro within ± 3 %, wheels 2 % apart) are driven for 60 s and
identified. They drive LEARNED laps of a rectangle over two tags and are identified by both runs: the tags tell how far
the model's speed is off. Switched on anew, they follow two shapes over tags that are all read. They also do so where 20
% are missed, 10 % read twice and 5 % taken for the other one.
"""

from collections.abc import Callable, Sequence
from functools import partial

from baqueano.diagnostics import Verdict
from baqueano.identify import FitOptions, identify
from baqueano.identify.noise.covariances import measure_noise
from baqueano.language import marked as N_
from baqueano.study.corridor.vehicles import switched_on_anew, vehicles
from baqueano.study.driving import FREE, SHAPES, experiments, guess
from baqueano.study.marks.drives import Team, follow, with_tags
from baqueano.study.marks.result import Lap, Marks, laps_of
from baqueano.study.truth import TagFaults
from baqueano.sweep.workers import spread_over

LEARNED, SPEED_M_S = 5, 0.3
ROUTES = ("rectangle", "eight")
READ = {N_("all read"): TagFaults(), N_("faults"): TagFaults(missed=0.2, twice=0.1, mistaken=0.05)}
BATCH = 10  # robots side by side


def marks(
    seeds: int = 20, first: int = 0, laps: int = 50, processes: int = 1, backend: str = "auto",
    shapes: Sequence[str] = ROUTES, read: Sequence[str] = tuple(READ),
    each: Callable[[int], None] = lambda k: None,
) -> Marks:  # fmt: skip
    """Return the laps of robots `first` … `first + seeds − 1`; `each` hears of the robots that are done."""
    jobs = [range(k, min(k + BATCH, first + seeds)) for k in range(first, first + seeds, BATCH)]
    work = partial(batch, laps=laps, backend=backend, shapes=shapes, read=read)
    parts = spread_over(work, jobs, processes, lambda batches: each(batches * BATCH))
    refusals = tuple(sorted(k for _, _, seeds_refused in parts for k in seeds_refused))
    return Marks(
        tuple(lap for _, rows, _ in parts for lap in rows), sum(n for n, _, _ in parts), laps, refusals
    )


def batch(
    seeds: range, laps: int, backend: str, shapes: Sequence[str], read: Sequence[str]
) -> tuple[int, list[Lap], list[int]]:
    """Return how many robots these are, their laps, and whose fit was refused."""
    team, refusals = identified(seeds, backend)
    return len(seeds), driven(team, laps, backend, shapes, read), refusals


def driven(team: Team, laps: int, backend: str, shapes: Sequence[str], read: Sequence[str]) -> list[Lap]:
    """Return the laps of a team."""
    out: list[Lap] = []
    for shape in shapes:
        drives = follow(team, SHAPES[shape](SPEED_M_S), laps, [READ[mode] for mode in read], backend)
        for mode, shape_laps in zip(read, drives, strict=True):
            out += laps_of(shape_laps, shape, mode, team.seeds, laps)
    return out


def identified(seeds: range, backend: str) -> tuple[Team, list[int]]:
    """Return robots with their files, by an experiment and laps over tags, and the seeds whose fit was refused."""
    robots = vehicles(seeds)
    runs = experiments(robots, seeds)
    fits = [identify(run, guess(), FREE, options=FitOptions(backend=backend)) for run in runs]
    usable = [k for k, fit in enumerate(fits) if fit.verdict != Verdict.REFUSED]
    learning = Team([fits[k].vehicle_file for k in usable], robots.some(usable), [seeds[k] for k in usable])
    route, files, names = SHAPES["rectangle"](SPEED_M_S), [], []
    (laps,) = follow(learning, route, LEARNED, [TagFaults()], backend, log=True)
    for k, file, seed, over in zip(usable, learning.files, learning.seeds, laps.runs, strict=True):
        both = [runs[k], over]
        fit = identify(both, with_tags(file, route), FREE, use=("imu",), options=FitOptions(backend=backend))
        if fit.verdict != Verdict.REFUSED:
            noise = measure_noise(fit, both, backend=backend)
            files.append(noise.updated(fit.vehicle_file, file.name))
            names.append(seed)
    restarted_robots = switched_on_anew(robots.some([seed - seeds[0] for seed in names]), names, files)
    return Team(files, restarted_robots, names), [seed for seed in seeds if seed not in names]
