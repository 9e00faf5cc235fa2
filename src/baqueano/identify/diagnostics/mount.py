"""Is the IMU mounted, or its columns written, as the model believes? The same search with its axes otherwise.

Asked where something is in doubt and a channel does not follow what the file's own numbers say of it (axes.py). For
each way of M: axes swapped, turned by a quarter or a half, one of them inverted,

    gain = Σ_c n_c log σ_c(as it is) − Σ_c n_c log σ_c(other way),   over the n of the IMU                 (1)

after a rough search from the file's numbers, over the first MOST rows. Turned ways are no way to tell for a vehicle
whose commands and frictions may be anything along x and y: the model turns with the IMU. Mirrored ones are: the
acceleration of a turn, ν_x ω, points to the left in a turn to the left, whatever the gains. Of four mirrored ways that
leave the same the commands choose: the one in which they do what the file says, forward is forward and left is left.
A way is named if it leaves a tenth less, which is a gain of n/10: no chance, and far from what a wrong way brings to a
model that lacks something.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.optional import has_field
from baqueano.diagnostics import Diagnostic, Severity, note
from baqueano.identify.data.record import FitRecord, FittedBlocks, beginning
from baqueano.identify.diagnostics import against_file, axes
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.residuals.simulation import Residuals
from baqueano.runs.diagnostics.signal_map import NO_RELATION, relations

if TYPE_CHECKING:
    from baqueano.identify.identifiability.identifiable import FinishedFit

MOST = 3000  # rows of each run
WORTH = 0.1  # of the logarithm of σ, a reading of the IMU
ALIKE = 0.5  # of the largest gain: ways that bring so much are one by the data


class MountWay(NamedTuple):
    """z of the IMU as it should be: its columns `order`, times `sign`."""

    order: tuple[int, int, int]
    sign: tuple[float, float, float]
    code: str


AXES = ("axes.swapped", "axes.inverted", "file.swapped", "file.inverted")
WAYS = (
    MountWay((1, 0, 2), (1.0, 1.0, 1.0), "mount.swapped"),
    MountWay((0, 1, 2), (-1.0, 1.0, 1.0), "mount.first-inverted"),
    MountWay((0, 1, 2), (1.0, -1.0, 1.0), "mount.second-inverted"),
    MountWay((0, 1, 2), (1.0, 1.0, -1.0), "mount.third-inverted"),
    MountWay((0, 1, 2), (-1.0, -1.0, 1.0), "mount.half-turn"),
    MountWay((1, 0, 2), (1.0, -1.0, 1.0), "mount.quarter-turn-second"),
    MountWay((1, 0, 2), (-1.0, 1.0, 1.0), "mount.quarter-turn-first"),
)  # fmt: skip


def told(end: "FinishedFit", found: list[Diagnostic]) -> list[Diagnostic]:
    """`found` about a finished search, and which way an IMU is mounted where that is the
    reason: then it stands before the doubts about axes and signs that say the same, in place of the others."""
    task, blocks = end.task, end.blocks
    if type(task.problem) is not Residuals or all(one.severity == Severity.INFO for one in found):
        return found
    for name, block in blocks.sensors._asdict().items():
        if has_field(block, "gyro_scale") and _astray(task, name) and (named := _named(end, name)):
            kind = "axes.swapped" if named[0].order[0] else "axes.inverted"
            rest = [one for one in found if one.code not in AXES or one.code == kind]
            return [named[1], *rest]
    return found


def _astray(task: Task, name: str) -> bool:
    """Whether some channel of the IMU does not follow what the file's numbers say of it, or another's more."""
    found = relations(*axes.of_sensor(task.problem, task.first, name))
    rho = np.array([[one.correlation for one in row] for row in found])
    own, any_of = np.diagonal(rho), np.max(np.abs(rho), axis=1)
    related = any(one.is_clear() for row in found for one in row)
    return related and bool(np.any((own < NO_RELATION) | (own < any_of)))


def _named(end: "FinishedFit", name: str) -> tuple[MountWay, Diagnostic] | None:
    """The way that leaves less and does as the file says, and the sentence for it."""
    task, blocks = end.task, end.blocks
    records = [beginning(record, MOST) for record in task.problem.records]
    at = sum(task.problem.sizes[: task.problem.names.index(name)])
    own = slice(at, at + 3)
    n = np.sum([r.sensors[name].has.sum(axis=0) for r in records], axis=0)
    begun = [
        task.first,
        np.where(np.isfinite(end.found.solution.theta), end.found.solution.theta, task.first),
    ]
    here = min(
        (_searched(task, blocks, records, theta) for theta in begun), key=lambda one: _left(one, own, n)
    )
    ways = [
        (way, _searched(task, blocks, [_other_way(r, name, way) for r in records], begun[0])) for way in WAYS
    ]
    gains = [_left(here, own, n) - _left(found, own, n[list(way.order)]) for way, found in ways]
    best = max(gains)
    if not best > WORTH * n.sum():
        return None
    for gain, (way, found) in zip(gains, ways, strict=True):
        if gain > ALIKE * best and _as_in_the_file(task, blocks, found):
            sigma = found.sigma[own][np.argsort(way.order)]  # of the columns as they are in the run
            less = ", ".join(f"{a:.2g} → {b:.2g}" for a, b in zip(here.sigma[own], sigma, strict=True))
            return way, note(way.code, Severity.ERROR, subject=name, less=less)
    return None


def _searched(task: Task, blocks: FittedBlocks, records: list[FitRecord], theta: np.ndarray) -> Search:
    problem = Residuals(blocks, task.problem.shape, records, task.problem.scan.backend)
    return search(task._replace(problem=problem, say=None), theta, rough=True)


def _other_way(record: FitRecord, name: str, way: MountWay) -> FitRecord:
    order, said = list(way.order), record.sensors[name]
    z, has = said.z[:, order] * np.array(way.sign), said.has[:, order]
    return record._replace(sensors={**record.sensors, name: said._replace(z=z, has=has)})


def _left(found: Search, own: slice, n: np.ndarray) -> float:
    """Σ n log σ over the channels of the IMU, of which there are n (3,).  (1)"""
    left = float(n @ np.log(found.sigma[own]))
    return left if np.isfinite(left) and np.isfinite(found.solution.at.cost) else np.inf


def _as_in_the_file(task: Task, blocks: FittedBlocks, end: Search) -> bool:
    names = task.problem.shape.shared
    found = against_file.gains(blocks, names, end.solution.theta[: len(names)], np.zeros(len(names)))
    return not any(one.code in AXES for one in found)
