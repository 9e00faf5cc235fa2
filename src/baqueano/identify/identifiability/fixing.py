"""The search once more, with what the data do not show held where it was."""

from collections.abc import Sequence

import numpy as np

from baqueano.identify.covariance.information import Information, information
from baqueano.identify.data.segments import without_starts
from baqueano.identify.estimation.search import Search, Task, search
from baqueano.identify.identifiability.identifiable import Seen, seen
from baqueano.identify.parallel import each
from baqueano.identify.parameters.free import DELAY, Free
from baqueano.identify.residuals.simulation import Residuals
from baqueano.sensors.sampling import tells_pose


def without_the_unseen(task: Task, found: Search, free: Sequence[Free]) -> tuple[Search, Seen, Information]:
    """The same search with all that the data do not show held where it was; `free` are the first entries of θ."""
    problem = found.problem
    whole = len(problem.layout.runs) == max(problem.layout.runs) + 1
    told = problem.size if whole else problem.layout.starts  # starts of pieces are of no interest
    held, ties = np.zeros(told, bool), {}
    while True:
        problem, theta = found.problem, found.solution.theta
        info = information(problem, theta)
        if not whole:
            A, B = without_starts(info.bread, info.meat, problem.layout)
            info = info._replace(bread=A, meat=B, channels=info.channels[:, :told])
        if task.believed is not None:  # a tape has no signal to compare with
            info = info._replace(channels=info.channels * (task.believed == 0.0)[:, None])
        span = (task.high - task.low)[:told]
        span[[k for k, one in enumerate(free) if one.path == DELAY]] = np.inf
        sight = seen(info, energy(problem, theta), theta[:told], free, held, span)
        ties |= sight.tied
        if np.array_equal(~sight.kept, held):
            return found, sight._replace(tied=ties), info
        held = ~sight.kept
        still = np.concatenate([held, np.zeros(problem.size - told, bool)])
        again = search(task, np.where(still, task.first, theta), still, found)
        found = again._replace(evaluations=found.evaluations + again.evaluations)


def energy(problem: Residuals, theta: np.ndarray) -> np.ndarray:
    """(m,) of what the model says of each channel, in standard deviations of the noise, about its mean: that of all
    rows, or of each piece where the piece has a number for itself that explains it."""

    def of(r: np.ndarray, z: np.ndarray, has: np.ndarray, weight: np.ndarray) -> np.ndarray:
        h = (z * weight - r) * has
        return np.array([np.einsum("tc,tc->c", h, h), np.einsum("tc->c", h), np.einsum("tc->c", has)])

    rows = sum(map(len, problem.z))
    sums = np.array(each(of, problem.residuals(theta), problem.z, problem.has, problem.weights, rows=rows))
    square, total, count = sums.transpose(1, 0, 2)  # (pieces, m) each
    of_pieces = np.sum(total**2 / np.maximum(count, 1.0), axis=0)
    of_all = np.sum(total, axis=0) ** 2 / np.maximum(np.sum(count, axis=0), 1.0)
    return np.sum(square, axis=0) - np.where(one_mean(problem), of_all, of_pieces)


def one_mean(problem: Residuals) -> np.ndarray:
    """(m,) True for channels whose mean no piece explains for itself: by a start, a bias, or where it is."""
    told = {name.split(".")[1] for name in problem.shape.by_run}
    sensors = problem._blocks.sensors._asdict()
    alone = [not (problem.shape.start or name in told or tells_pose(sensors[name])) for name in problem.names]
    return np.repeat(alone, problem.sizes)
