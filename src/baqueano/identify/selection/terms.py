"""Define the optional terms of a vehicle model, each with its neutral value and its starts.

The least model of a kind contains the forces (or velocities) of the commands and viscous friction; for a car also the
steering. Everything else is a term: dry friction, dead zones, drag, lag and delay, cross-talk, unequal motors, battery,
centre of mass. At its neutral value a term has no effect. Its largest possible size gives the starts of a search:

    friction, drag     0.1 and 0.3 of the value that would balance the largest command                     (1)
    dead zone          0.05 and 0.25 of the largest command                                                (2)
    lag, delay         0.05 s; a delay, whose cost has a kink at every whole tick, every 0.025 s            (3)

or the field's `start`. For (1) the largest commands drive the model for REACH_S, one channel at a time and all
together. The change of ν̇ by a unit of the parameter is divided by the largest ν̇. A parameter without a change is not
a term. Names, neutral values and starts are defined with the fields of the class (parameter.py); their order is
explained in docs/derivations/d_optimal_design.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.diagnostics import Diagnostic, fault, nearest, note
from baqueano.errors import UsageError
from baqueano.identify.covariance.quantiles import QUANTILE_95
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import (
    DELAY,
    LAG,
    LONGEST_DELAY_S,
    OF_WHEELS,
    always_free,
    entries,
    free_parameter,
    frozen_columns,
    requested_paths,
    value,
    words_of,
)
from baqueano.parameter import all_parameters
from baqueano.symbolic import compile_block, get, put
from baqueano.vehicles.freedoms import ideal

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, Tree
    from baqueano.vehicle_file import VehicleFile

BATTERY = "model.drivetrain.battery_effect"
SCAN_S = 0.025  # between starts of a delay: half a period of the fastest command that is followed, 20 Hz
REACH_S, TICK_S, SOON_S = 1.0, 0.005, 1e-6  # of (1): duration, step, and the step for the change of ν̇
PARTS, UNIT = (0.1, 0.3), 1e-3  # of (1)
SHORTEST_LAG_S = 1e-5  # without effect, but not 0, so that it can be varied
DEAD_ZONES = ("model.drivetrain.dead_zone_forward", "model.drivetrain.dead_zone_backward")


class Term(NamedTuple):
    """An optional part of a model."""

    name: str  # in words
    paths: tuple[str, ...]  # (q,) with entries
    neutral: tuple[float, ...]  # (q,) values at which it is without effect
    starts: tuple[tuple[float, ...], ...]  # (k, q) starts of the searches


def least_free(vehicle_file: "VehicleFile", free: Sequence[str] | None, u: np.ndarray) -> list[str]:
    """Return the paths, with entries, that the least model fits. `free` contains the paths that the user requested,
    u (N, n) all commands."""
    blocks = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors)
    optional = {path for term in terms_of(blocks, u) for path in term.paths}
    paths = [p for path in requested_paths(free, lambda: always_free(blocks)) for p in entries(blocks, path)]
    candidates = [free_parameter(blocks, p, {}) for p in paths if p not in optional]
    frozen_numbers = frozen_columns(candidates, u)
    return [candidate.path for k, candidate in enumerate(candidates) if k not in frozen_numbers]


def without_terms(vehicle_file: "VehicleFile", terms: Sequence[Term]) -> "VehicleFile":
    """Return the file with all terms at their neutral values."""
    return with_terms(vehicle_file, terms, {})


def with_terms(vehicle_file: "VehicleFile", terms: Sequence[Term], fitted: dict[str, float]) -> "VehicleFile":
    """Return the file with the values `fitted` at their paths, and all other paths of `terms` neutral."""
    blocks, fields = room_for(FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors), terms), set()
    for term in terms:
        for path, none in zip(term.paths, term.neutral, strict=True):
            blocks = put(blocks, path, fitted.get(path, none))
            fields.add(path.partition("[")[0])
    values = {field: np.asarray(get(blocks, field), float).tolist() for field in sorted(fields)}
    if LAG in values and LAG not in fitted:
        values[LAG] = 0.0
    changes = {k: v for k, v in values.items() if not _same(v, vehicle_file.value(k))}
    return vehicle_file.with_values(changes) if changes else vehicle_file


def room_for(blocks: FittedBlocks, terms: Sequence[Term]) -> FittedBlocks:
    """Return the blocks in a form that can contain the terms: a lag, and dead zones of each channel."""
    drivetrain = getattr(blocks.model, "drivetrain", None)
    if drivetrain is None:
        return blocks
    changes: JsonObject = {}
    requested_paths = {path.partition("[")[0] for term in terms for path in term.paths}
    if LAG in requested_paths and drivetrain.lag_s == 0.0:
        changes["lag_s"] = SHORTEST_LAG_S
    for field in (*DEAD_ZONES, "model.drivetrain.gain"):
        name = field.rpartition(".")[2]
        if field in requested_paths and len(getattr(drivetrain, name)) < drivetrain.channels:
            changes[name] = np.repeat(getattr(drivetrain, name), drivetrain.channels)
    return put(blocks, "model.drivetrain", replace(drivetrain, **changes)) if changes else blocks


def terms_of(blocks: FittedBlocks, u: np.ndarray, battery: bool = False) -> list[Term]:
    """Return all terms of a vehicle with the commands u (N, n); `battery` is True if its voltage was logged."""
    blocks = blocks._replace(model=ideal(blocks.model))
    motions = _motions(blocks.model, u)
    own = _of_fields(blocks, motions)
    return own + _of_drivetrain(blocks.model, motions, battery) + _cross_talk(blocks, u)


def candidate_terms(
    blocks: FittedBlocks, candidates: Sequence[str | Term] | None, u: np.ndarray, battery: bool
) -> list[Term]:
    """Return the candidates: all terms of the kind, or the terms with the given names or paths of the vehicle file.
    Raise UsageError for an unknown name."""
    terms = terms_of(blocks, u, battery)
    if candidates is None:
        return terms
    by_name, out = {term.name: term for term in terms}, []
    for candidate in candidates:
        if isinstance(candidate, Term):
            out.append(candidate)
        elif candidate in by_name:
            out.append(by_name[candidate])
        elif candidate.startswith(("model.", "sensors.")):
            paths = tuple(entries(blocks, candidate))
            out.append(
                Term(candidate, paths, (0.0,) * len(paths), (tuple(value(blocks, p) or 0.1 for p in paths),))
            )
        else:
            raise UsageError(
                fault(
                    "choose.no-term",
                    found=candidate,
                    kind=type(blocks.model).__name__,
                    near=nearest(candidate, by_name),
                )
            )
    return out


class _TermMotion(NamedTuple):
    """Motion of a vehicle from rest under the largest commands of some channels."""

    w: np.ndarray  # (k,) the channels
    u: np.ndarray  # (n,) the command
    state: "Tree"  # after REACH_S
    most: np.ndarray  # (3,) largest |ν̇| during the motion


def _motions(model: "Tree", u: np.ndarray) -> list[_TermMotion]:
    """Return the motions of each used channel in both directions, then of all channels together."""
    drivetrain = model.drivetrain
    channels = np.asarray([drivetrain.mix(row) for row in u[:: max(1, len(u) // 2000)]])
    low, high = np.min(channels, axis=0, initial=0.0), np.max(channels, axis=0, initial=0.0)
    axes = np.eye(len(high))
    ways = [w for w in (*(axes * high), *(axes * low)) if np.any(w)]
    ways += [w for w in (high, low) if np.count_nonzero(w) > 1]
    quick = compile_block(model)
    return [_drive(quick, w, drivetrain.unmix(w)) for w in ways]


def _drive(model: "Tree", w: np.ndarray, u: np.ndarray) -> _TermMotion:
    state, most = model.init(), np.zeros(3)
    with np.errstate(all="ignore"):
        for _ in range(round(REACH_S / TICK_S)):
            state, motion = model.step(state, u, TICK_S, np.zeros(3))
            most = np.fmax(most, np.abs(motion.nu_dot))
    return _TermMotion(w, u, state, most)


def _of_fields(blocks: FittedBlocks, motions: Sequence[_TermMotion]) -> list[Term]:
    """Return the terms that the fields of the model define.  (1)"""
    by_name: dict[str, list[tuple[str, float, tuple[float, ...]]]] = {}
    for field, p in all_parameters(blocks.model, "model"):
        if not p.term or p.role == "gain" or (field.startswith(OF_WHEELS) and not _track(blocks)):
            continue
        for path in entries(blocks, field):
            neutral = value(blocks, path) if p.neutral is None else p.neutral
            starts = tuple(neutral + x for x in p.start) or _sizes(blocks, path, neutral, motions)
            if starts:
                name = words_of(p.term, free_parameter(blocks, path, {}).entry)
                by_name.setdefault(name, []).append((path, neutral, starts))
    return [
        Term(name, tuple(paths), tuple(neutral), tuple(zip(*starts, strict=True)))
        for name, (paths, neutral, starts) in ((k, zip(*some, strict=True)) for k, some in by_name.items())
    ]


def _sizes(
    blocks: FittedBlocks, path: str, neutral: float, motions: Sequence[_TermMotion]
) -> tuple[float, ...]:
    """Return the starts of the search for a parameter; () for a parameter without effect.  (1)"""
    most = np.max([m.most for m in motions], axis=0, initial=1e-9)
    with_, without = (put(blocks, path, neutral + x).model for x in (UNIT, 0.0))
    slope = 0.0
    for m in motions:
        now, then = (x.step(m.state, m.u, SOON_S, np.zeros(3))[1].nu_dot for x in (with_, without))
        change = np.abs(now - then) / UNIT / most
        slope = max(slope, float(np.max(change)) if np.all(np.isfinite(change)) else 0.0)
    return tuple(neutral + part / slope for part in PARTS) if slope > 1e-9 else ()


def _track(blocks: FittedBlocks) -> float:
    return float(getattr(getattr(blocks.model, "friction", None), "track_m", 0.0))


def _cross_talk(blocks: FittedBlocks, u: np.ndarray) -> list[Term]:
    """Return the terms by which a command acts on other axes."""
    axes_moved, out = np.flatnonzero(np.any(u != 0.0, axis=0)), []
    for field, p in all_parameters(blocks.model, "model"):
        if p.term and p.role == "gain":
            matrix = get(blocks, field)
            both = [(i, j) for j in axes_moved for i in range(len(matrix)) if i != j]
            paths = tuple(f"{field}[{i},{j}]" for i, j in both)
            start = tuple(0.02 * float(matrix[j, j]) for _, j in both)
            name = words_of(p.term, ())
            out += [Term(name, paths, (0.0,) * len(paths), (start,))] if paths else []
    return out


def _of_drivetrain(model: "Tree", motions: Sequence[_TermMotion], battery: bool) -> list[Term]:
    moving = [m for m in motions if np.any(m.most > 0.0)]  # a servo without a motor moves nothing
    single, out = [m for m in moving if np.count_nonzero(m.w) == 1], []
    for way, field, sign in zip(("forward", "backward"), DEAD_ZONES, (1.0, -1.0), strict=True):
        commands = [(k, abs(float(m.w[k]))) for m in single for k in np.flatnonzero(sign * m.w > 0.0)]
        paths = tuple(f"{field}[{k}]" for k, _ in commands)
        starts = tuple(tuple(part * size for _, size in commands) for part in (0.05, 0.25))
        if paths:
            out.append(Term(f"dead zone {way}", paths, (0.0,) * len(paths), starts))
    if len(out) == 2:
        paths, starts = out[0].paths + out[1].paths, zip(out[0].starts, out[1].starts, strict=True)
        out.insert(0, Term("dead zone", paths, (0.0,) * len(paths), tuple(a + b for a, b in starts)))
    out.append(_term("motor lag", LAG, 0.05)._replace(neutral=(SHORTEST_LAG_S,)))
    out.append(_term("delay", DELAY, *((k + 0.5) * SCAN_S for k in range(round(LONGEST_DELAY_S / SCAN_S)))))
    if model.drivetrain.mixing == "two_wheels":
        gain = Term("unequal motors", ("model.drivetrain.gain[1]",), (1.0,), ((1.02,),))
        out += [gain, _term("battery sag", "model.drivetrain.sag", 0.05)]
    if battery:
        out.append(_term("battery voltage", BATTERY, 0.5, 1.0))
    return out


def _term(name: str, path: str, *starts: float) -> Term:
    return Term(name, (path,), (0.0,), tuple((float(start),) for start in starts))


def _same(a: Any, b: Any) -> bool:
    x, y = np.asarray(a, float), np.asarray(b, float)
    return x.shape == y.shape and bool(np.all(x == y))


def not_separated(term: Term, x: np.ndarray, sd: np.ndarray) -> Diagnostic | None:
    """Return the reason why the runs do not separate the effect κ of the battery. Return None for other terms, or if
    κ is known to ± 0.5 and, within its error, between 0 and 1."""
    half = QUANTILE_95 * float(sd[0])
    if term.paths != (BATTERY,) or (2.0 * half <= 1.0 and -half <= x[0] <= 1.0 + half):
        return None
    return note("term.battery-not-separable", value=x[0], half=half)
