"""Vehicle file + route → gains: the paper's cost and a price on jerks (cost.py), its exact gradient through the
compiled loop, L-BFGS-B. The vehicle starts `aside_m` behind and beside its route, so that the feedback has work: a
model that is right needs none on its route. The paper's cost alone is effort_m2 = 0 and aside_m = 0; its gains drive
from limit to limit.

Default: the loop with perfect pose, as the paper says ("η_e is obtained by simulating the system"). With
`estimator=True` the file's own estimator stands in the loop and the sensors have their noise, one fixed draw
of it; the pose that is judged is the vehicle's, not the believed one, and converters have no steps (a
staircase has no slope). With `draws` the cost is the mean over vehicles drawn from the covariance of the fit:
gains that suit one exact vehicle are too sharp for the real one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Guide
from baqueano.contracts.values import JsonObject
from baqueano.diagnostics import fault
from baqueano.errors import BaqueanoError, UsageError
from baqueano.geometry import compose
from baqueano.guides.route import Route
from baqueano.language import marked as N_
from baqueano.parameter import parameters
from baqueano.simulate.closed_loop import closed, closed_loop, start_of, ticks_of
from baqueano.simulate.many import drawn
from baqueano.simulate.open_loop import draw, times
from baqueano.simulate.system import Input, System, begin
from baqueano.symbolic import put
from baqueano.tune.cost import Weights, shown, tick_cost
from baqueano.tune.search import STARTS, UNUSABLE, Descent, at_limit, search
from baqueano.tune.tuned import Gain, TunedDrive, TuneResult

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

THE_PAPERS = ("alpha", "beta", "gamma")
RADIAN_M = 0.1  # where the file gives no track and no radius
HUBER_M = 0.1
ASIDE_M = (
    0.1  # on its route, a vehicle whose model is right needs no feedback, and no gain would have a slope
)
EFFORT_M2 = 0.1
SMALLEST = {"m": 0.005, "rad": 0.01, "rad/s": 0.05, "m/s": 0.02}  # error that may ask for the full command


class SoughtGains(NamedTuple):
    """The gains that are looked for."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: np.ndarray  # (p,)
    high: np.ndarray  # (p,)
    before: np.ndarray  # (p,) in the file, NaN where it has none

    @property
    def first(self) -> JsonObject:
        """Allowed values, to build the block with."""
        values = np.where(np.isfinite(self.before), self.before, 0.5 * (self.low + self.high))
        return dict(zip(self.names, values.tolist(), strict=True))


def tune(
    vehicle_file: "VehicleFile",
    route: Route | Guide,
    *,
    starts: int = STARTS,
    polish: bool = True,
    **options: Any,
) -> TuneResult:
    """Find the gains of the file's controller with which its vehicle follows a route best.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The identified vehicle and its controller.
    route : Route or guide
        What to follow.
    starts : int
        Number of descents, beside one from the file's own gains.
    polish : bool
        Search on without slopes where the cost is rough, at up to ten times the time.
    **options : object
        Keywords of `rehearse`: gains, bounds, laps, duration_s, estimator, draws, seed, …

    Returns
    -------
    TuneResult
        The gains; `.applied()` is the vehicle file with them.

    Raises
    ------
    UsageError
        For a gain that the controller lacks, wrong bounds, or a vehicle that diverges with all gains.

    References
    ----------
    Grotz et al., `equ:controller_cost_function`, with a price on jerks and a start beside the route; effort_m2=0,
    aside_m=0 give the paper's alone (cost.py).

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.vehicle_file import load
    >>> tuned = tune(load("small"), circle(0.3, 0.2), gains=["k_chi"], starts=1, polish=False, duration_s=2.0)
    >>> tuned.cost < tuned.cost_before, tuned.gains[0].unit
    (True, '1/s')
    """
    rehearsal = rehearse(vehicle_file, route, **options)
    sought = rehearsal.asked
    own = [sought.before] if np.all(np.isfinite(sought.before)) else []
    descents = search(
        rehearsal.cost, rehearsal.cost_and_gradient, sought.low, sought.high, own, starts, polish
    )
    return _tuned(vehicle_file, rehearsal, descents, own)


def rehearse(
    vehicle_file: "VehicleFile",
    route: Route | Guide,
    *,
    gains: Sequence[str] | None = None,
    bounds: dict[str, tuple[float, float]] | None = None,
    laps: int = 1,
    duration_s: float | None = None,
    radian_m: float | None = None,
    huber_m: float = HUBER_M,
    effort_m2: float = EFFORT_M2,
    aside_m: float = ASIDE_M,
    estimator: bool = False,
    draws: int = 0,
    seed: int = 0,
    backend: str = "auto",
) -> "Rehearsal":
    """The cost of a drive along `route`, as compiled functions of the gains.

    `gains` and their `bounds`: all scalar parameters of the controller, unless named; `laps` of the route, or
    `duration_s` of it. `radian_m` is what a radian weighs, `huber_m` the distance beyond which errors count linearly,
    `effort_m2` the price of a change of the command from limit to nothing within a tick; 0 gives the cost of the paper,
    which has no such price. `aside_m`: how far behind and to the left of the route's start the vehicle begins, 0 in the
    paper. `estimator`: in the loop, with the noise of `seed`; `draws`: vehicles from the covariance of the fit.
    """
    weights = weights_of(vehicle_file, radian_m, huber_m, effort_m2)
    if not np.isfinite(aside_m):
        raise UsageError(fault("tune.aside", aside_m=aside_m))
    asked = sought(vehicle_file, gains, bounds or {})
    system = closed(vehicle_file, route, laps, not estimator, vehicle_file.controller(**asked.first))
    system = unquantised(system)
    rate = vehicle_file.rate_hz
    ticks = ticks_of(system, rate) if duration_s is None else max(1, round(duration_s * rate))
    noise = draw(system.sensors, seed, ticks) if estimator else None
    own, vehicles, _ = drawn(vehicle_file, system, draws, seed) if draws else ((), np.zeros((1, 0)), 0)
    paths = (*(f"controller.{name}" for name in asked.names), *own)
    make = partial(closed_loop, system, rate, noise=estimator, backend=backend, paths=paths)
    return Rehearsal(
        asked,
        weights,
        N_("estimator in the loop") if estimator else N_("perfect pose"),
        vehicles,
        Input(times(ticks, rate), noise),
        begin(system, compose(start_of(system), np.array([-aside_m, aside_m, 0.0]))),
        make(output=partial(tick_cost, weights, vehicle_file.command.limit)),
        make(output=partial(shown, vehicle_file.command.limit)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsal:
    """The drive that is tried again and again."""

    asked: SoughtGains
    weights: Weights
    loop: str  # in words
    vehicles: np.ndarray  # (v, q) drawn parameters; (1, 0): the file's own vehicle alone
    _inputs: Input
    _start: Any
    _cost: Any  # kernels
    _shown: Any

    @property
    def backend(self) -> str:
        """Return the back end of the kernels."""
        return self._cost.backend

    def cost(self, gains: np.ndarray) -> float:
        """C [m²], the mean over the vehicles."""
        each = [self._cost.cost(self._inputs, self._with(gains, v), carry=self._start) for v in self.vehicles]
        return float(np.mean(each))

    def cost_and_gradient(self, gains: np.ndarray) -> tuple[float, np.ndarray]:
        """C and ∂C/∂gains (p,)."""
        total, slope = 0.0, np.zeros(len(gains))
        for v in self.vehicles:
            c, g = self._cost.cost_and_gradient(self._inputs, self._with(gains, v), carry=self._start)
            total, slope = total + c, slope + g[: len(gains)]
        return total / len(self.vehicles), slope / len(self.vehicles)

    def drive(self, gains: np.ndarray) -> TunedDrive:
        """Return the drives of the vehicles with these gains."""
        each = [
            self._shown.run(self._inputs, self._with(gains, v), carry=self._start)[1] for v in self.vehicles
        ]
        d, psi, full = (np.concatenate(x) for x in zip(*each, strict=True))
        return TunedDrive(rms(d), float(np.max(d)), rms(psi), float(np.mean(full)))

    @staticmethod
    def _with(gains: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
        return np.concatenate([gains, vehicle])


def unquantised(system: System) -> System:
    """Return the system without the steps of converters and timers: the slope of a staircase is 0."""
    blocks = [("model.drivetrain", getattr(system.model, "drivetrain", None))]
    for path, block in [*blocks, *((f"sensors.{name}", s) for name, s in system.sensors._asdict().items())]:
        for field, _ in parameters(block) if is_dataclass(block) else ():
            if field.endswith("_step"):
                system = put(system, f"{path}.{field}", 0.0 * getattr(block, field))
    return system


def rms(x: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(x**2)))


def _tuned(
    vehicle_file: "VehicleFile", rehearsal: Rehearsal, descents: list, own: list[np.ndarray]
) -> TuneResult:
    sought, best = rehearsal.asked, descents[0]
    if best.cost >= UNUSABLE:
        raise UsageError(fault("tune.all-run-away", vehicle=vehicle_file.name))
    limits = at_limit(best.gains, sought.low, sought.high)
    gains_ = tuple(_gain(rehearsal, k, best, int(limits[k])) for k in range(len(sought.names)))
    rows = [(k, c) for k, descent in enumerate(descents) for c in descent.costs]
    return TuneResult(
        vehicle_file,
        gains_,
        best.cost,
        rehearsal.cost(own[0]) if own else float("nan"),
        rehearsal.cost(np.zeros(len(sought.low))),
        rehearsal.weights,
        rehearsal.drive(best.gains),
        tuple(descents),
        np.array(rows),
        rehearsal.loop,
        len(rehearsal.vehicles) if rehearsal.vehicles.shape[1] else 0,
        rehearsal.backend,
    )


def _gain(rehearsal: Rehearsal, k: int, best: Descent, limit: int) -> Gain:
    """Gain k, with the cost when it alone is smaller and larger."""
    sought, around = rehearsal.asked, []
    for factor in (0.8, 1.25):
        g = best.gains.copy()
        g[k] *= factor
        around.append(rehearsal.cost(g) / best.cost)
    named = sought.names[k], sought.units[k], float(best.gains[k]), float(sought.before[k])
    return Gain(*named, float(sought.low[k]), float(sought.high[k]), limit, *around)


def sought(
    vehicle_file: "VehicleFile", gains: Sequence[str] | None, bounds: dict[str, tuple[float, float]],
    kind: str | None = None,
) -> SoughtGains:  # fmt: skip
    """The gains, their bounds, and what the file has for them; `kind`: those of another controller."""
    try:
        block = vehicle_file.controller(kind)
    except BaqueanoError:  # gains are still to be found: they are what the file lacks
        wanted = THE_PAPERS if gains is None else tuple(gains)
        anything: JsonObject = dict.fromkeys(wanted, 1.0)
        block, known = vehicle_file.controller(kind, **anything), False
    else:
        known = True
    fields = {name: p for name, p in parameters(block) if p.shape == ()}
    names = tuple(fields) if gains is None else tuple(gains)
    if not names:
        raise UsageError(fault("tune.no-gains", kind=type(block).__name__))
    for name in [*names, *bounds]:
        if name not in fields:
            raise UsageError(
                fault("tune.no-such-gain", kind=type(block).__name__, found=repr(name), known=fields)
            )
    limit = vehicle_file.command.limit
    full = float(np.max(limit[np.isfinite(limit)], initial=0.0)) or 1.0
    low, high = np.array([_bounds(name, fields[name], full, bounds) for name in names], dtype=float).T
    for name, l, h in zip(names, low, high, strict=True):
        if not (np.isfinite(l) and np.isfinite(h) and l < h):
            raise UsageError(fault("tune.bounds", name=name, low=l, high=h))
    before = [float(getattr(block, name)) if known else float("nan") for name in names]
    return SoughtGains(names, tuple(fields[name].unit for name in names), low, high, np.array(before))


def _bounds(name: str, p: Any, full: float, bounds: dict[str, tuple[float, float]]) -> tuple[float, float]:
    """Return the given ones, else those of the field, else 0 and the full command for the smallest error."""
    if name in bounds:
        return bounds[name]
    error = SMALLEST.get(p.unit.rpartition(" per ")[2], 0.01)
    return (p.low if np.isfinite(p.low) else 0.0), (p.high if np.isfinite(p.high) else full / error)


def weights_of(
    vehicle_file: "VehicleFile", radian_m: float | None, huber_m: float, effort_m2: float
) -> Weights:
    """The settings of the cost, checked."""
    weights = Weights(_radian(vehicle_file) if radian_m is None else radian_m, huber_m, effort_m2)
    if not (weights.radian_m >= 0.0 and huber_m > 0.0 and effort_m2 >= 0.0):
        raise UsageError(
            fault("tune.weights", radian_m=weights.radian_m, huber_m=huber_m, effort_m2=effort_m2)
        )
    return weights


def _radian(vehicle_file: "VehicleFile") -> float:
    """Half the track [m], else the platform's radius, else RADIAN_M."""
    geometry = vehicle_file.geometry
    if geometry.track_m is not None:
        return 0.5 * geometry.track_m
    return geometry.radius_m if geometry.radius_m is not None else RADIAN_M
