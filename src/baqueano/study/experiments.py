"""`baqueano study experiments`: how much a designed experiment tells, beside four signals in the same room.

Vehicles whose parameters are drawn uniformly within ± SPREAD of those of three files of the garage. Each is
planned for with the nominal file, and driven by the drawn vehicle with its process noise: what is told is the
information at the drawn vehicle (design/information.py), as the geometric mean over its parameters of

    standard error / value                                                                                (1)

at the Cramér-Rao bound, sensor biases and the start estimated with them; and in how many of the drives, with
DRIVES different noises of each vehicle, the body left the room. All signals are at most as large as the file
allows and go through the same `contained`.
"""

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baqueano.identify.design import (
    Belief,
    Informant,
    Room,
    believed,
    contained,
    designed,
    mean_error,
    room_of,
)
from baqueano.identify.design.belief import Cloud
from baqueano.identify.design.inside import VEHICLES
from baqueano.identify.signals import KINDS, excitation
from baqueano.vehicle_file import load
from baqueano.worlds.noise import stream

SPREAD = 0.3
DRIVES = 10
ROOMS = {"small": ("2x2", 7), "case-study-1": ("3x3", 7), "car": ("4x4", 6)}  # file → room, vehicles
DESIGNED, BASELINE = "designed", "random_steps"
RATIO = 1.5


class Row(NamedTuple):
    """One signal on the vehicles of one file, or of all."""

    vehicle: str
    room: str
    signal: str
    mean_error: float  # geometric mean over vehicles and parameters
    ratio: float  # random steps ÷ this
    above_best: int  # vehicles of which it tells less than the best of the other signals
    vehicles: int
    left: int  # drives in which the body left the room
    drives: int
    nearest_m: float  # least distance of a body to a wall, over all drives
    seconds: float  # that it took to make, the slowest


@dataclass(frozen=True, slots=True, eq=False)
class Experiments:
    """The table."""

    each: tuple[Row, ...]
    duration_s: float

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is not as it should be."""
        out, said = [], {row.vehicle: row for row in self.each if row.signal == DESIGNED}
        if said["all"].ratio < RATIO:
            out.append(
                f"designed is {said['all'].ratio:.2f} times better than random steps, not {RATIO:g} times"
            )
        if above := said["all"].above_best:
            out.append(f"of {above} vehicles another signal tells more")
        left = sum(row.left for row in self.each if row.vehicle != "all")
        if left:
            out.append(f"in {left} drives the body left the room")
        if said["all"].seconds > self.duration_s / 6.0:
            out.append(
                f"the design took {said['all'].seconds:.1f} s, more than a sixth of {self.duration_s:g} s"
            )
        return tuple(out)

    @property
    def verdict(self) -> str:
        """USABLE or WARN."""
        return "WARN" if self.reasons else "USABLE"

    def rows(self) -> list[dict[str, Any]]:
        """One flat row per file and signal."""
        return [row._asdict() for row in self.each]

    def table(self) -> str:
        """Text."""
        head = f"{'vehicles':14}{'room':6}{'signal':14}{'mean error':>11}{'better':>8}{'above best':>12}"
        lines = [f"{head}{'left':>10}{'nearest':>9}{'made in':>9}"]
        for r in self.each:
            lines.append(
                f"{r.vehicle:14}{r.room:6}{r.signal:14}{100.0 * r.mean_error:>9.4f} %{r.ratio:>7.2f}×"
                f"{r.above_best:>6} of {r.vehicles:<2}{r.left:>5} of {r.drives:<3}{100.0 * r.nearest_m:>5.0f} cm"
                f"{r.seconds:>7.1f} s"
            )
        return "\n".join([*lines, *(f"! {reason}" for reason in self.reasons)])


class Drawn(NamedTuple):
    """What one signal did to the vehicles of one file."""

    errors: np.ndarray  # (V,)
    margins: np.ndarray  # (V · DRIVES,) [m]
    seconds: float


def experiments(
    seed: int = 0, duration_s: float = 60.0, backend: str = "auto", say: Any = lambda text: None
) -> Experiments:
    """The table over the vehicles of ROOMS."""
    rows, every = [], {}
    for name, (size, count) in ROOMS.items():
        say(f"{name}: {count} vehicles in {size} m")
        found = of_file(name, size, count, seed, duration_s, backend)
        rows += _rows(name, size, found)
        for signal, drawn in found.items():
            every.setdefault(signal, []).append(drawn)
    whole = {signal: _joined(parts) for signal, parts in every.items()}
    return Experiments((*rows, *_rows("all", "", whole)), duration_s)


def of_file(name: str, size: str, count: int, seed: int, duration_s: float, backend: str) -> dict[str, Drawn]:
    """Signal → what it did to `count` vehicles around the file."""
    file = load(name)
    room, belief = room_of(file, size), believed(file, vehicles=VEHICLES)
    informant, cloud = Informant(file, backend), Cloud(file, belief, seed, backend)
    unit = stream(seed, f"vehicles.{name}").uniform(-SPREAD, SPREAD, (count, len(belief.paths)))
    vehicles = belief.theta[0] * (1.0 + unit)
    begun = time.perf_counter()
    plan = designed(file, room, duration_s, seed=seed, backend=backend)
    took, out = time.perf_counter() - begun, {}
    us = [plan.u] * count
    out[DESIGNED] = _driven(us, vehicles, file, room, informant, belief.paths, seed, took, backend)
    for kind in KINDS:
        us, slowest = [], 0.0
        for k in range(count):
            begun = time.perf_counter()
            asked = excitation(kind, file.command.limit, duration_s, file.rate_hz, seed + k, rest_s=1.0)
            us.append(contained(asked, file, room, cloud=cloud).u)
            slowest = max(slowest, time.perf_counter() - begun)
        out[kind] = _driven(us, vehicles, file, room, informant, belief.paths, seed, slowest, backend)
    return out


def _driven(
    us: list[np.ndarray], vehicles: np.ndarray, file: Any, room: Room, informant: Informant,
    paths: tuple[str, ...], seed: int, took: float, backend: str,
) -> Drawn:  # fmt: skip
    """Each vehicle (V, p) under its signal, DRIVES times."""
    errors, margins = [], []
    for k, (u, numbers) in enumerate(zip(us, vehicles, strict=True)):
        theta = informant.theta(paths, numbers)
        errors.append(mean_error(informant.relative_sd(informant.information(u, theta))))
        same = Belief(paths, np.tile(numbers, (DRIVES + 1, 1)))  # the first has no noise
        cloud = Cloud(file, same, seed + 1000 + k, backend)
        _, eta = cloud.drive(cloud.at(room.start), u)
        margins.append(np.min(room.free - np.abs(eta[1:, :, :2]), axis=(1, 2)))
    return Drawn(np.array(errors), np.concatenate(margins), took)


def _rows(vehicle: str, size: str, found: dict[str, Drawn]) -> list[Row]:
    base = _geometric(found[BASELINE].errors)
    rows = []
    for signal, drawn in found.items():
        others = np.min([d.errors for s, d in found.items() if s != signal], axis=0)
        error = _geometric(drawn.errors)
        rows.append(
            Row(
                vehicle, size, signal, error, base / error, int(np.sum(drawn.errors > others)), len(drawn.errors),
                int(np.sum(drawn.margins < 0.0)), len(drawn.margins), float(drawn.margins.min()), drawn.seconds,
            )
        )  # fmt: skip
    return rows


def _joined(parts: list[Drawn]) -> Drawn:
    errors, margins = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return Drawn(errors, margins, max(part.seconds for part in parts))


def _geometric(x: np.ndarray) -> float:
    return float(np.exp(np.mean(np.log(x))))
