"""`baqueano study marks`: fifty laps over two tags on the floor, by an IMU and an identified model.

Robots of the independent truth are driven for 60 s and identified, then drive LEARNED laps of a rectangle over two tags
and are identified by both runs: the tags tell how far the model's speed is off. Then they follow three shapes, over
tags that are all read, and over tags of which 20 % are missed, 10 % read twice and 5 % taken for the other one.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from baqueano.identify import excitation, identify
from baqueano.identify.noise import measure_noise
from baqueano.runs import Run
from baqueano.runs.run import Channel
from baqueano.simulate.open_loop import times
from baqueano.study.driving import EXPERIMENT_S, FREE, SHAPES, guess, together
from baqueano.study.marks.drives import RATE_HZ, Gyros, follow, with_tags
from baqueano.study.marks.result import Lap, Marks, laps_of
from baqueano.study.truth import Faults, Robots, drawn
from baqueano.study.workers import spread_over
from baqueano.vehicle_file import VehicleFile

LEARNED, SPEED_M_S = 5, 0.3
READ = {"all read": Faults(), "faults": Faults(missed=0.2, twice=0.1, mistaken=0.05)}
BATCH = 10  # robots side by side


def marks(
    seeds: int = 20, first: int = 0, laps: int = 50, processes: int = 1, backend: str = "auto",
    shapes: Sequence[str] = tuple(SHAPES), read: Sequence[str] = tuple(READ),
    each: Callable[[int], None] = lambda k: None,
) -> Marks:  # fmt: skip
    """Return the laps of robots `first` … `first + seeds − 1`; `each` hears of the robots that are done."""
    jobs = [range(k, min(k + BATCH, first + seeds)) for k in range(first, first + seeds, BATCH)]
    work = partial(batch, laps=laps, backend=backend, shapes=shapes, read=read)
    found = spread_over(work, jobs, processes, lambda done: each(done * BATCH))
    refused = tuple(sorted(k for _, _, refused in found for k in refused))
    return Marks(
        tuple(lap for _, rows, _ in found for lap in rows), sum(n for n, _, _ in found), laps, refused
    )


def batch(
    seeds: range, laps: int, backend: str, shapes: Sequence[str], read: Sequence[str]
) -> tuple[int, list[Lap], list[int]]:
    """Return how many robots these are, their laps, and whose fit was refused."""
    robots = together([drawn(1, seed) for seed in seeds])
    files, refused = identified(robots, seeds, backend)
    kept = [k for k, seed in enumerate(seeds) if seed not in refused]
    robots, names, out = robots.some(kept), [seeds[k] for k in kept], []
    for shape in shapes:
        for how in read:
            route = SHAPES[shape](SPEED_M_S)
            driven = follow(files, robots, route, laps, names, READ[how], backend)
            out += laps_of(driven, shape, how, names, laps)
    return len(seeds), out, refused


def identified(robots: Robots, seeds: Sequence[int], backend: str) -> tuple[list[VehicleFile], list[int]]:
    """Return the files by an experiment and laps over tags, and the seeds whose fit was refused."""
    runs = _experiments(robots, seeds)
    fits = [identify(run, guess(), FREE, backend=backend) for run in runs]
    kept = [k for k, fit in enumerate(fits) if fit.verdict != "REFUSED"]
    route, names = SHAPES["rectangle"](SPEED_M_S), [seeds[k] for k in kept]
    files = [fits[k].vehicle_file for k in kept]
    over_tags = follow(files, robots.some(kept), route, LEARNED, names, Faults(), backend).runs
    out, refused = [], [seed for seed in seeds if seed not in names]
    for k, file, seed, over in zip(kept, files, names, over_tags, strict=True):
        both = [runs[k], over]
        fit = identify(both, with_tags(file, route), FREE, use=("imu",), backend=backend)
        refused += [seed] if fit.verdict == "REFUSED" else []
        noise = measure_noise(fit, both, backend=backend)
        out += [] if fit.verdict == "REFUSED" else [noise.updated(fit.vehicle_file, file.name)]
    return out, refused


def _experiments(robots: Robots, seeds: Sequence[int]) -> list[Run]:
    """Return a run of random steps of each robot."""
    file = guess()
    u = excitation("random_steps", file.command.limit, EXPERIMENT_S, file.rate_hz, 0, rest_s=2.0)
    t_ns, gyros = times(len(u), RATE_HZ), Gyros(robots, seeds, np.zeros((len(seeds), 3)))
    z = np.stack([gyros.tick(np.tile(row, (len(seeds), 1))) for row in u], axis=1)
    told = {"kind": "experiment", "rate_hz": f"{RATE_HZ:g}"}
    return [
        Run(
            f"robot {k}",
            None,
            t_ns,
            u,
            sensors={"imu": Channel(t_ns, t_ns, x)},
            vehicle_text=file.text,
            metadata=told,
        )
        for k, x in zip(seeds, z, strict=True)
    ]
