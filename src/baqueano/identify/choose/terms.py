"""What a model of a vehicle may have besides the least that it needs, each with its neutral value and starts.

The least model of a kind has forces (or velocities) of the commands and viscous friction; of a car also what
steers it. Everything else is a term: dry friction, of the body and of each wheel, dead zones, quadratic drag, drag of
cornering, lag and delay of the motors, cross-talk of the commands, unequal motors, sag and voltage of the battery, a
centre of mass that is not where the file says. A dead zone stands among them both ways at once too: beside dry
friction, which resembles it, one way alone shows little. They stand in the
order in which they are believed where the data cannot tell them apart: first what holds in both directions and
without a command, then what a command does, one way last. At its neutral value
a term is not there. Where a search begins is told by the size that a term can have at most:

    dry friction       a tenth, and 3 tenths, of the largest force that was commanded                      (1)
    dead zone          a twentieth, and a quarter, of the largest command                                  (2)
    quadratic drag     as much as the viscous one at top speed, d_l² / F_max                               (3)
    lag, delay         0.05 s; a delay, whose cost has a kink at every whole tick, every 0.025 s            (4)
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baqueano.blocks import closest
from baqueano.errors import UsageError
from baqueano.identify.blocks import Blocks
from baqueano.identify.solve.parameters import ALWAYS, DELAY, LAG, LONGEST_DELAY_S, asked, entries, value
from baqueano.symbolic import get, put
from baqueano.vehicles import Car, Kinematic, Planar

if TYPE_CHECKING:
    from baqueano.vehicle_file import VehicleFile

BATTERY = "model.drivetrain.battery_effect"
SCAN_S = 0.025  # between starts of a delay: half a period of the fastest command that is followed, 20 Hz
SHORTEST_LAG_S = 1e-5  # that is none at all, and can be computed with
DEAD_ZONES = ("model.drivetrain.dead_zone_forward", "model.drivetrain.dead_zone_backward")


class Term(NamedTuple):
    """A part of a model that may be there or not."""

    name: str  # in words
    paths: tuple[str, ...]  # (q,) with entries
    neutral: tuple[float, ...]  # (q,) values at which it is not there
    starts: tuple[tuple[float, ...], ...]  # (k, q) where searches begin


def least_free(file: "VehicleFile", free: Sequence[str] | None, u: np.ndarray) -> list[str]:
    """Paths, with entries, that the least model fits; `free` are the caller's, u (N, n) all commands."""
    blocks = Blocks(file.vehicle, file.sensors)
    optional = {path for term in terms_of(blocks, u) for path in term.paths}
    kind = type(file.vehicle)

    def needed() -> tuple[str, ...]:
        if kind in ALWAYS:
            return ALWAYS[kind]
        raise UsageError(
            f"{kind.__name__} is a model of your own: say what its least form fits, free=[…], and what may be "
            "added, candidates=[…]. Type: --free KEY"
        )

    paths = [p for path in asked(free, needed) for p in entries(blocks, path)]
    return [p for p in paths if p not in optional and _moves(p, u)]


def without_terms(file: "VehicleFile", terms: Sequence[Term]) -> "VehicleFile":
    """The file with all terms at their neutral values."""
    return with_terms(file, terms, {})


def with_terms(file: "VehicleFile", terms: Sequence[Term], found: dict[str, float]) -> "VehicleFile":
    """The file with the values `found` at their paths, all other paths of `terms` neutral."""
    blocks, fields = room_for(Blocks(file.vehicle, file.sensors), terms), set()
    for term in terms:
        for path, none in zip(term.paths, term.neutral, strict=True):
            blocks = put(blocks, path, found.get(path, none))
            fields.add(path.partition("[")[0])
    values = {field: np.asarray(get(blocks, field), float).tolist() for field in sorted(fields)}
    if LAG in values and LAG not in found:
        values[LAG] = 0.0
    changed = {k: v for k, v in values.items() if not _same(v, file.value(k))}
    return file.with_values(changed) if changed else file


def room_for(blocks: Blocks, terms: Sequence[Term]) -> Blocks:
    """The blocks in a form that can carry the terms: a lag, and dead zones of each channel."""
    drivetrain = getattr(blocks.model, "drivetrain", None)
    if drivetrain is None:
        return blocks
    changes: dict[str, Any] = {}
    asked = {path.partition("[")[0] for term in terms for path in term.paths}
    if LAG in asked and drivetrain.lag_s == 0.0:
        changes["lag_s"] = SHORTEST_LAG_S
    for field in (*DEAD_ZONES, "model.drivetrain.gain"):
        name = field.rpartition(".")[2]
        if field in asked and len(getattr(drivetrain, name)) < drivetrain.channels:
            changes[name] = np.repeat(getattr(drivetrain, name), drivetrain.channels)
    return put(blocks, "model.drivetrain", replace(drivetrain, **changes)) if changes else blocks


def terms_of(blocks: Blocks, u: np.ndarray, battery: bool = False) -> list[Term]:
    """All terms of a vehicle whose commands were u (N, n); `battery`: its voltage was logged."""
    model = blocks.model
    if type(model) is Car:
        return _of_car(blocks, u) + _of_drivetrain(model, u, battery)
    if type(model) is Planar:
        talk = _cross_talk(model.actuator_matrix, "model.actuator_matrix", u)
        return _of_planar(blocks, u) + _of_drivetrain(model, u, battery) + talk
    if type(model) is Kinematic:
        talk = _cross_talk(model.velocity_matrix, "model.velocity_matrix", u)
        return _of_drivetrain(model, u, battery) + talk
    return []


def asked_for(
    blocks: Blocks, candidates: Sequence[str | Term] | None, u: np.ndarray, battery: bool
) -> list[Term]:
    """The candidates: all terms of the kind, or those of the names, or paths of the vehicle file."""
    known = terms_of(blocks, u, battery)
    if candidates is None:
        return known
    by_name, out = {term.name: term for term in known}, []
    for one in candidates:
        if isinstance(one, Term):
            out.append(one)
        elif one in by_name:
            out.append(by_name[one])
        elif one.startswith(("model.", "sensors.")):
            paths = tuple(entries(blocks, one))
            out.append(
                Term(one, paths, (0.0,) * len(paths), (tuple(value(blocks, p) or 0.1 for p in paths),))
            )
        else:
            raise UsageError(
                f'candidates = "{one}": there is no such term of a {type(blocks.model).__name__}.'
                f"{closest(one, list(by_name))} Known are {', '.join(by_name)}, and paths as model.…"
            )
    return out


def _of_car(blocks: Blocks, u: np.ndarray) -> list[Term]:
    model: Car = blocks.model
    most = max(model.throttle_gain * float(np.max(np.abs(u[:, 0]), initial=0.0)), 1e-6)
    drag = max(model.linear_drag, 0.1)
    return [
        _one("dry friction", "model.coulomb_m_s2", 0.1 * most, 0.3 * most),
        _one("quadratic drag", "model.quadratic_drag", 0.3 * drag**2 / most),
        _one("drag of the driven motor", "model.motor_drag", 2.0 * drag),
        _one("drag of cornering", "model.cornering_drag", 0.1 * drag),
    ]


def _of_planar(blocks: Blocks, u: np.ndarray) -> list[Term]:
    model: Planar = blocks.model
    most = np.max(np.abs(u) @ np.abs(np.diag(np.diag(model.actuator_matrix))), axis=0, initial=1e-9)
    linear = np.maximum(model.friction.linear, 1e-6)
    out = []
    for i, way in enumerate(("forward", "sideways", "turning")):
        push = most[i] if i != 1 or most[1] > 1e-6 else 0.1 * most[0]
        size = linear[i] ** 2 / push
        out.append(_one(f"quadratic drag {way}", f"model.friction.quadratic[{i}]", 0.3 * size))
        if i != 1 or most[1] > 1e-6:
            path = f"model.friction.coulomb[{i}]"
            out.append(_one(f"dry friction {way}", path, 0.1 * push, 0.3 * push))
    out += _of_wheels(model, u, 0.5 * float(most[0]))
    out.append(_one("drag of cornering", "model.friction.cornering", 0.1 * float(linear[0])))
    c = model.centre_of_mass_x_m  # the file's, by tape: the term is that it is elsewhere
    out.append(_one("centre of mass", "model.centre_of_mass_x_m", c + 0.01, c - 0.01)._replace(neutral=(c,)))
    return out


def _of_wheels(model: Planar, u: np.ndarray, push: float) -> list[Term]:
    """Dry friction of gears and bearings, of each wheel and way by itself; `push` is the most that drives one."""
    if model.drivetrain.mixing != "two_wheels" or not model.friction.track_m > 0.0:
        return []
    channels = np.asarray([model.drivetrain.mix(row) for row in u[:: max(1, len(u) // 2000)]])
    paths = tuple(
        f"model.friction.{field}[{k}]"
        for field, sign in (("coulomb_forward", 1.0), ("coulomb_backward", -1.0))
        for k in range(2)
        if np.any(sign * channels[:, k] > 0.0)
    )
    starts = tuple((part * push,) * len(paths) for part in (0.1, 0.3))
    return [Term("dry friction of the wheels", paths, (0.0,) * len(paths), starts)] if paths else []


def _cross_talk(matrix: np.ndarray, path: str, u: np.ndarray) -> list[Term]:
    """What a command does besides its own axis."""
    moved = np.flatnonzero(np.any(u != 0.0, axis=0))
    paths = tuple(f"{path}[{i},{j}]" for j in moved for i in range(3) if i != j)
    start = tuple(0.02 * float(matrix[j, j]) for j in moved for i in range(3) if i != j)
    return [Term("cross-talk", paths, (0.0,) * len(paths), (start,))] if paths else []


def _of_drivetrain(model: Any, u: np.ndarray, battery: bool) -> list[Term]:
    drivetrain = model.drivetrain
    channels = np.asarray([drivetrain.mix(row) for row in u[:: max(1, len(u) // 2000)]])
    moved = np.flatnonzero(np.any(channels != 0.0, axis=0)).tolist()
    moved = [k for k in moved if k == 0] if isinstance(model, Car) else moved  # a servo has no dead zone
    most = [float(np.max(np.abs(channels[:, k]))) for k in moved]
    out = []
    for way, field, sign in zip(("forward", "backward"), DEAD_ZONES, (1.0, -1.0), strict=True):
        used = [(k, size) for k, size in zip(moved, most, strict=True) if np.any(sign * channels[:, k] > 0.0)]
        paths = tuple(f"{field}[{k}]" for k, _ in used)
        starts = tuple(tuple(part * size for _, size in used) for part in (0.05, 0.25))
        if paths:
            out.append(Term(f"dead zone {way}", paths, (0.0,) * len(paths), starts))
    if len(out) == 2:
        paths, starts = out[0].paths + out[1].paths, zip(out[0].starts, out[1].starts, strict=True)
        out.insert(0, Term("dead zone", paths, (0.0,) * len(paths), tuple(a + b for a, b in starts)))
    out.append(_one("motor lag", LAG, 0.05)._replace(neutral=(SHORTEST_LAG_S,)))
    out.append(_one("delay", DELAY, *((k + 0.5) * SCAN_S for k in range(round(LONGEST_DELAY_S / SCAN_S)))))
    if drivetrain.mixing == "two_wheels":
        gain = Term("unequal motors", ("model.drivetrain.gain[1]",), (1.0,), ((1.02,),))
        out += [gain, _one("battery sag", "model.drivetrain.sag", 0.05)]
    if battery:
        out.append(_one("battery voltage", BATTERY, 0.5, 1.0))
    return out


def _one(name: str, path: str, *starts: float) -> Term:
    return Term(name, (path,), (0.0,), tuple((float(start),) for start in starts))


def _moves(path: str, u: np.ndarray) -> bool:
    """Whether the command of a matrix' column, if it is one, moved."""
    if "matrix[" not in path:
        return True
    return bool(np.any(u[:, int(path.rpartition("[")[2].rstrip("]").split(",")[1])] != 0.0))


def _same(a: Any, b: Any) -> bool:
    x, y = np.asarray(a, float), np.asarray(b, float)
    return x.shape == y.shape and bool(np.all(x == y))
