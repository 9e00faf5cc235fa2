"""Define the optional terms of a vehicle model, each with its neutral value and its starts.

The least model of a kind contains the forces (or velocities) of the commands and viscous friction; for a car also the
steering. All other effects are terms: dry friction, dead zones, drag, lag and delay, cross-talk, unequal motors,
battery, centre of mass. At its neutral value a term does not have an effect. The starts of a search are fractions of
its largest possible value:

    friction, drag     0.1 and 0.3 of the value that would balance the largest command                     (1)
    dead zone          0.05 and 0.25 of the largest command                                                (2)
    lag, delay         0.05 s; a delay, whose cost has a kink at every whole tick, every 0.025 s            (3)

or the field's `start`. For (1) the model drives for TRIAL_S with the largest commands, one channel at a time and all
together. The change of ν̇ by a unit of the parameter is divided by the largest ν̇. A parameter without a change is
not a term. Names, neutral values and starts are defined with the fields of the class (parameter.py); their order is
explained in docs/derivations/d_optimal_design.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baqueano.contracts.optional import attribute
from baqueano.contracts.values import JsonObject, Tree
from baqueano.diagnostics import nearest
from baqueano.errors import UsageError
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.parameters.free import (
    BATTERY_EFFECT,
    LAG_PATH,
    SERVO_LAG_PATH,
    WHEEL_FRICTIONS,
    default_free,
    driven_axes,
    entries,
    entry_text,
    fixed_columns,
    free_parameter,
    requested_paths,
    value,
)
from baqueano.messages.language import mark as N_
from baqueano.parameter import Parameter, all_parameters, parameters
from baqueano.symbolic import compile_block, value_at_path, with_value
from baqueano.vehicle_file import VehicleFile
from baqueano.vehicles.freedoms import with_ideal_drivetrain

TRIAL_S, TICK_S, SHORT_STEP_S = 1.0, 0.005, 1e-6  # of (1): duration, step, and the step for the change of ν̇
SPEED_FRACTIONS, UNIT_STEP = (0.1, 0.3), 1e-3  # of (1)
MIN_LAG_S = 1e-5  # without effect, but not 0, so that it can be varied
LAGS = ("lag_s", "servo_lag_s")
DEAD_ZONE_PATHS = ("model.drivetrain.dead_zone_forward", "model.drivetrain.dead_zone_backward")


class Term(NamedTuple):
    """An optional part of a model."""

    name: str  # in words
    paths: tuple[str, ...]  # (q,) with entries
    neutral: tuple[float, ...]  # (q,) values at which the term does not have an effect
    starts: tuple[tuple[float, ...], ...]  # (k, q) starts of the searches
    requires: str = ""  # field of the term without which this term has no effect


def minimal_free(vehicle_file: VehicleFile, free: Sequence[str] | None, u: np.ndarray) -> list[str]:
    """Return the paths, with entries, that the least model fits. `free` contains the paths that the user requested,
    u (N, n) all commands."""
    blocks = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors)
    optional = {path for term in vehicle_terms(blocks, u) for path in term.paths}
    fields = requested_paths(free, lambda: default_free(blocks))
    paths = [path for field in fields for path in entries(blocks, field)]
    candidates = [free_parameter(blocks, p, {}) for p in paths if p not in optional]
    frozen_numbers = fixed_columns(candidates, u)
    return [candidate.path for k, candidate in enumerate(candidates) if k not in frozen_numbers]


def without_terms(vehicle_file: VehicleFile, terms: Sequence[Term]) -> VehicleFile:
    """Return the file with all terms at their neutral values."""
    return with_terms(vehicle_file, terms, {})


def with_terms(
    vehicle_file: VehicleFile, terms: Sequence[Term], fitted_values: dict[str, float]
) -> VehicleFile:
    """Return the file with the values `fitted_values` at their paths, and all other paths of `terms` neutral."""
    blocks, fields = with_term_slots(FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors), terms), set()
    for term in terms:
        for path, none in zip(term.paths, term.neutral, strict=True):
            blocks = with_value(blocks, path, fitted_values.get(path, none))
            fields.add(path.partition("[")[0])
    values = {field: np.asarray(value_at_path(blocks, field), float).tolist() for field in sorted(fields)}
    values |= dict.fromkeys(({LAG_PATH, SERVO_LAG_PATH} & values.keys()) - fitted_values.keys(), 0.0)
    changes = {k: v for k, v in values.items() if not np.array_equal(v, vehicle_file.value(k))}
    return vehicle_file.with_values(changes) if changes else vehicle_file


def with_term_slots(blocks: FittedBlocks, terms: Sequence[Term]) -> FittedBlocks:
    """Return the blocks in a form that can contain the terms: a lag, and dead zones of each channel."""
    drivetrain = getattr(blocks.model, "drivetrain", None)
    if drivetrain is None:
        return blocks
    changes: JsonObject = {}
    requested_paths = {path.partition("[")[0] for term in terms for path in term.paths}
    for name in LAGS:
        if f"model.drivetrain.{name}" in requested_paths and getattr(drivetrain, name) == 0.0:
            changes[name] = MIN_LAG_S
    for field in (*DEAD_ZONE_PATHS, "model.drivetrain.gain"):
        name = field.rpartition(".")[2]
        if field in requested_paths and len(getattr(drivetrain, name)) < drivetrain.channels:
            changes[name] = np.repeat(getattr(drivetrain, name), drivetrain.channels)
    return with_value(blocks, "model.drivetrain", replace(drivetrain, **changes)) if changes else blocks


def vehicle_terms(blocks: FittedBlocks, u: np.ndarray, battery: bool = False) -> list[Term]:
    """Return all terms of a vehicle with the commands u (N, n); `battery` is True if its voltage was logged."""
    blocks = blocks._replace(model=with_ideal_drivetrain(blocks.model))
    motions = _motions(blocks.model, u)
    field_terms = _field_terms(blocks, motions)
    return field_terms + _drivetrain_terms(blocks.model, motions, battery) + _cross_talk_terms(blocks, u)


def candidate_terms(
    blocks: FittedBlocks, candidates: Sequence[str | Term] | None, u: np.ndarray, battery: bool
) -> list[Term]:
    """Return the candidates: all terms of the kind, or the terms with the given names or paths of the vehicle file.
    Raise UsageError for an unknown name."""
    terms = vehicle_terms(blocks, u, battery)
    if candidates is None:
        return terms
    by_name, chosen_terms = {term.name: term for term in terms}, []
    for candidate in candidates:
        if isinstance(candidate, Term):
            chosen_terms.append(candidate)
        elif candidate in by_name:
            chosen_terms.append(by_name[candidate])
        elif candidate.startswith(("model.", "sensors.")):
            paths = tuple(entries(blocks, candidate))
            start = tuple(value(blocks, path) or 0.1 for path in paths)
            chosen_terms.append(Term(candidate, paths, (0.0,) * len(paths), (start,)))
        else:
            kind, suggestion = type(blocks.model).__name__, nearest(candidate, by_name)
            raise UsageError.of("choose.no-term", value=candidate, kind=kind, suggestion=suggestion)
    return chosen_terms


class _TermMotion(NamedTuple):
    """Motion of a vehicle from rest under the largest commands of some channels."""

    w: np.ndarray  # (k,) the channels
    u: np.ndarray  # (n,) the command
    state: Tree  # after TRIAL_S
    max_nu: np.ndarray  # (3,) largest |ν̇| during the motion


def _motions(model: Tree, u: np.ndarray) -> list[_TermMotion]:
    """Return the motions of each used channel in both directions, then of all channels together."""
    drivetrain = model.drivetrain
    channels = np.asarray([drivetrain.mix(row) for row in u[:: max(1, len(u) // 2000)]])
    low, high = np.min(channels, axis=0, initial=0.0), np.max(channels, axis=0, initial=0.0)
    axes = np.eye(len(high))
    commands = [w for w in (*(axes * high), *(axes * low)) if np.any(w)]
    commands += [w for w in (high, low) if np.count_nonzero(w) > 1]
    quick_model = compile_block(model)
    return [_drive(quick_model, w, drivetrain.unmix(w)) for w in commands]


def _drive(model: Tree, w: np.ndarray, u: np.ndarray) -> _TermMotion:
    state, max_nu = model.init(), np.zeros(3)
    with np.errstate(all="ignore"):
        for _ in range(round(TRIAL_S / TICK_S)):
            state, motion = model.step(state, u, TICK_S, np.zeros(3))
            max_nu = np.fmax(max_nu, np.abs(motion.nu_dot))
    return _TermMotion(w, u, state, max_nu)


def _field_terms(blocks: FittedBlocks, motions: Sequence[_TermMotion]) -> list[Term]:
    """Return the terms that the fields of the model define.  (1)"""
    by_name: dict[str, list[tuple[str, float, tuple[float, ...]]]] = {}
    requires: dict[str, str] = {}
    has_track = getattr(getattr(blocks.model, "friction", None), "track_m", 0.0) != 0.0
    for field, p in all_parameters(blocks.model, "model"):
        is_of_drivetrain = field.startswith("model.drivetrain.")
        if not p.term or is_of_drivetrain or p.role == "gain":
            continue
        if field.startswith(WHEEL_FRICTIONS) and not has_track:
            continue
        for path in entries(blocks, field):
            neutral = value(blocks, path) if p.neutral is None else p.neutral
            starts = tuple(neutral + x for x in p.start) or _search_starts(blocks, path, neutral, motions)
            if starts:
                name = entry_text(p.term, free_parameter(blocks, path, {}).entry)
                by_name.setdefault(name, []).append((path, neutral, starts))
                requires[name] = _required_field(field, p)
    return [
        Term(name, tuple(paths), tuple(neutral), tuple(zip(*starts, strict=True)), requires[name])
        for name, (paths, neutral, starts) in ((k, zip(*group, strict=True)) for k, group in by_name.items())
    ]


def _required_field(field: str, p: Parameter) -> str:
    """Return the path of the field without which the parameter `field` has no effect; "" for none."""
    return f"{field.rpartition('.')[0]}.{p.requires}" if p.requires else ""


def _search_starts(
    blocks: FittedBlocks, path: str, neutral: float, motions: Sequence[_TermMotion]
) -> tuple[float, ...]:
    """Return the starts of the search for a parameter, or () for a parameter without an effect.  (1)"""
    max_nu = np.max([m.max_nu for m in motions], axis=0, initial=1e-9)
    changed_model, base = (with_value(blocks, path, neutral + x).model for x in (UNIT_STEP, 0.0))
    sensitivity = 0.0
    for m in motions:
        extended_nu_dot, base_nu_dot = (
            x.step(m.state, m.u, SHORT_STEP_S, np.zeros(3))[1].nu_dot for x in (changed_model, base)
        )
        change = np.abs(extended_nu_dot - base_nu_dot) / UNIT_STEP / max_nu
        sensitivity = max(sensitivity, float(np.max(change)) if np.all(np.isfinite(change)) else 0.0)
    fractions = SPEED_FRACTIONS if sensitivity > 1e-9 else ()
    return tuple(neutral + fraction / sensitivity for fraction in fractions)


def _cross_talk_terms(blocks: FittedBlocks, u: np.ndarray) -> list[Term]:
    """Return the terms by which a command acts on other axes."""
    axes_moved, terms = np.flatnonzero(np.any(u != 0.0, axis=0)), []
    for field, p in all_parameters(blocks.model, "model"):
        if p.term and p.role == "gain":
            matrix = value_at_path(blocks, field)
            pairs = [(i, j) for j in axes_moved for i in driven_axes(blocks) if i != j]
            paths = tuple(f"{field}[{i},{j}]" for i, j in pairs)
            start = tuple(0.02 * float(matrix[j, j]) for _, j in pairs)
            name = entry_text(p.term, ())
            terms += [Term(name, paths, (0.0,) * len(paths), (start,))] if paths else []
    return terms


def _drivetrain_terms(model: Tree, motions: Sequence[_TermMotion], battery: bool) -> list[Term]:
    # a servo without a motor does not move the vehicle
    moving_motions = [m for m in motions if np.any(m.max_nu > 0.0)]
    single_channel, terms = [m for m in moving_motions if np.count_nonzero(m.w) == 1], []
    names = N_("dead zone forward"), N_("dead zone backward")
    for name, field, sign in zip(names, DEAD_ZONE_PATHS, (1.0, -1.0), strict=True):
        commands = [(k, abs(float(m.w[k]))) for m in single_channel for k in np.flatnonzero(sign * m.w > 0.0)]
        paths = tuple(f"{field}[{k}]" for k, _ in commands)
        starts = tuple(tuple(fraction * magnitude for _, magnitude in commands) for fraction in (0.05, 0.25))
        if paths:
            terms.append(Term(name, paths, (0.0,) * len(paths), starts))
    if len(terms) == 2:
        paths, starts = terms[0].paths + terms[1].paths, zip(terms[0].starts, terms[1].starts, strict=True)
        terms.insert(0, Term(N_("dead zone"), paths, (0.0,) * len(paths), tuple(a + b for a, b in starts)))
    for name, p in parameters(model.drivetrain):
        if p.term and p.start and _has_effect(model, name):
            none = MIN_LAG_S if name in LAGS else p.neutral or 0.0
            path, starts = f"model.drivetrain.{name}", tuple((x,) for x in p.start)
            terms.append(Term(entry_text(p.term, ()), (path,), (none,), starts, _required_field(path, p)))
    if model.drivetrain.mixing == "two_wheels":
        terms.append(Term(N_("unequal motors"), ("model.drivetrain.gain[1]",), (1.0,), ((1.02,),)))
    if battery:
        terms.append(Term(N_("battery voltage"), (BATTERY_EFFECT,), (0.0,), ((0.5,), (1.0,))))
    return terms


def _has_effect(model: Tree, name: str) -> bool:
    """Return True if a field of the drivetrain can affect the motion of this model."""
    drivetrain = model.drivetrain
    if name == "servo_lag_s":
        return drivetrain.servos > 0
    if name == "back_emf_share":
        return attribute(model, "viscous_effort") is not None
    return name != "sag" or drivetrain.mixing == "two_wheels"
