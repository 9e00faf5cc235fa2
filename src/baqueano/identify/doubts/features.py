"""What is often not in a model: forces, delays and places of sensors, as columns for probes.py.

A force that nobody modelled pushes the vehicle along an axis a with an acceleration ε φ(t),

    ν ← ν + ε φ δ e_a,   ν̇ ← ν̇ + ε φ e_a,   D = (h_ε − h_0) / ε                                         (1)

simulated by the vehicle itself, many φ side by side in one kernel. With w the channels of the drivetrain
(left and right wheel, or the commands) and ν what the model says, both over their largest value, φ is one of

    tanh 10 w    w |w|    |w|    w (t/T − ½)    sign w e^(−s/0.2 s), s since w changed its sign             (2)
    tanh 10 ν    ν |ν|    ν³     |ν|            sign ν e^(−s/0.2 s), s since ν changed its sign             (3)
    ν_x |ν_ψ|    ν_x ν_ψ    ν_ψ²    ν_ψ |ν_x|    ν_ψ |ν_ψ|                                                 (4)

(2) are dead zones and backlash, motors that saturate or slip, that are unequal forward and backward, and a
battery that fades; (3) dry and other friction, a caster that flips; (4) what corners cost. Delays, lags and
clocks, an IMU elsewhere or turned on its mount change the readings alone:

    D = −ḣ  (each sensor, and all of them)    D = (−ν_ψ², ν̇_ψ), (−ν̇_ψ, −ν_ψ²), (a_y, −a_x), (−ν_ψ ν_y, ν_ψ ν_x)   (5)
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from baqueano.identify.rows.record import Record
from baqueano.identify.rows.voltage import VOLTAGE, at_voltage
from baqueano.identify.solve.parameters import Blocks, with_numbers
from baqueano.identify.solve.problem import Problem, Shape, _example, _felt, kept_kernel, vehicle_at_start
from baqueano.symbolic import scan

AFTER_S = 0.2  # how long something lasts that begins when a sign changes
SMALL = 0.1  # of the largest value: where a tanh has changed its sign
PUSH = 1e-3  # of the accelerations themselves
AT_ONCE = 400_000  # rows of all lanes together

Along = Callable[[np.ndarray, np.ndarray], np.ndarray]
Phi = Callable[[Record, "Motions"], np.ndarray]


class Pushed(NamedTuple):
    """What the simulation carries."""

    vehicle: Any
    past: tuple[np.ndarray, ...]


class Motions(NamedTuple):
    """What it shows, tick by tick."""

    h: np.ndarray  # (N, m)
    nu: np.ndarray  # (N, 3)
    nu_dot: np.ndarray  # (N, 3)


class Force(NamedTuple):
    """One φ along one axis."""

    code: str
    text: str
    axis: int
    phi: Phi


class Believed(NamedTuple):
    """The motion that a fit believes in, piece by piece."""

    kernel: Any
    theta: list[np.ndarray]
    motions: list[Motions]

    @property
    def nu(self) -> np.ndarray:
        """(N, 3) of all pieces."""
        return np.concatenate([m.nu for m in self.motions])

    @property
    def nu_dot(self) -> np.ndarray:
        """(N, 3) of all pieces."""
        return np.concatenate([m.nu_dot for m in self.motions])


def believed(blocks: Blocks, problem: Problem, theta: np.ndarray) -> Believed | None:
    """None for a model that cannot be pushed."""
    if not hasattr(blocks.model, "process_noise_std"):
        return None
    kernel = kept_kernel(blocks, problem.shape, problem.scan.backend, _traced)
    own = [theta[index] for index in problem.layout.indices]
    still = [
        _run(kernel, record, numbers, np.zeros((1, len(record.dt_s), 3)))[0]
        for record, numbers in zip(problem.records, own, strict=True)
    ]
    return Believed(kernel, own, still)


def probes(
    blocks: Blocks, problem: Problem, now: Believed
) -> Iterator[tuple[list[tuple[str, str]], np.ndarray]]:
    """Codes and words of some probes, and their columns D (K, N m) in standard deviations."""
    readings = [_readings(blocks, problem, r, m) for r, m in zip(problem.records, now.motions, strict=True)]
    said = [(code, text) for code, text, _ in readings[0]]
    columns = [np.stack([D for _, _, D in one]) for one in readings]
    yield said, _weighed(problem, columns)
    forces = _forces(blocks.model, problem.records)
    some = max(1, AT_ONCE // sum(len(r.dt_s) for r in problem.records))
    for at in range(0, len(forces), some):
        part = forces[at : at + some]
        columns = [
            _pushes(now.kernel, record, theta, still, part)
            for record, theta, still in zip(problem.records, now.theta, now.motions, strict=True)
        ]
        yield [(f"{f.code}, {('x', 'y', 'psi')[f.axis]}", f.text) for f in part], _weighed(problem, columns)


def _weighed(problem: Problem, columns: list[np.ndarray]) -> np.ndarray:
    """(K, N, m) per piece → (K, N m)."""
    for column, weight in zip(columns, problem.weights, strict=True):
        column *= weight
    return np.concatenate([c.reshape(len(c), -1) for c in columns], axis=1)


def _traced(blocks: Blocks, shape: Shape, backend: str) -> Any:
    n, paths = blocks.model.commands, (*shape.shared, *shape.own)
    vehicle_at = vehicle_at_start(blocks, shape)

    def start(theta: np.ndarray) -> Pushed:
        past = tuple(np.zeros((getattr(s, "delay_slots", 0), s.size)) for s in blocks.sensors)
        return Pushed(vehicle_at(theta), past)

    def step(theta: np.ndarray, state: Pushed, row: np.ndarray) -> tuple[Pushed, Any]:
        there = at_voltage(with_numbers(blocks, paths, theta), row, shape.volts)
        dt_s, u, push = row[0], row[1 : 1 + n], row[1 + n : 4 + n]
        vehicle = state.vehicle._replace(nu=state.vehicle.nu + push * dt_s)
        vehicle, motion = there.model.step(vehicle, u, dt_s, np.zeros(3))
        motion = motion._replace(nu_dot=motion.nu_dot + push)
        felt, past = _felt(there.sensors, motion, state.past, dt_s)
        return Pushed(vehicle, past), Motions(np.concatenate(felt), motion.nu, motion.nu_dot)

    return scan(step, start, np.zeros(1 + n + 3 + shape.volts), _example(blocks, shape), backend=backend)


def _run(kernel: Any, record: Record, theta: np.ndarray, push: np.ndarray) -> list[Motions]:
    """Motions for each of the pushes (L, N, 3)."""
    driven = np.column_stack([record.dt_s, record.u])
    parts = [np.broadcast_to(driven, (len(push), *driven.shape)), push]
    if VOLTAGE in record.sensors:
        parts.append(np.broadcast_to(record.sensors[VOLTAGE].z, (*push.shape[:2], 1)))
    rows = np.concatenate(parts, axis=2)
    _, out = kernel.lanes(rows, np.tile(theta, (len(push), 1)), outputs=True)
    return [Motions(*(x[k] for x in out)) for k in range(len(push))]


def _pushes(
    kernel: Any, record: Record, theta: np.ndarray, still: Motions, forces: list[Force]
) -> np.ndarray:
    """D (K, N, m).  (1)"""
    push, sizes = np.zeros((len(forces), len(record.dt_s), 3)), np.ones(len(forces))
    for k, force in enumerate(forces):
        phi = force.phi(record, still)
        large = float(np.sqrt(np.mean(phi**2)))
        felt = float(np.sqrt(np.mean(still.nu_dot[:, force.axis] ** 2)))
        sizes[k] = PUSH * (felt + 1e-6) / large if large > 0.0 else 1.0
        push[k, :, force.axis] = sizes[k] * phi
    pushed = _run(kernel, record, theta, push)
    with np.errstate(invalid="ignore", over="ignore"):
        D = np.stack([(shown.h - still.h) / size for shown, size in zip(pushed, sizes, strict=True)])
    return np.where(np.isfinite(D).all(axis=(1, 2), keepdims=True), D, 0.0)  # one that ran away asks nothing


def _forces(model: Any, records: tuple[Record, ...]) -> list[Force]:
    """(2)-(4) for all channels that move."""
    out = []
    largest = np.max([np.max(np.abs(_channels(model, r.u)), axis=0) for r in records], axis=0)
    for j in np.flatnonzero(largest > 0.0):
        for code, text, along in COMMANDED:
            phi = _commanded(model, int(j), float(largest[j]), along)
            out += [Force(f"{code} of channel {j}", text, a, phi) for a in (0, 2)]
    out += [Force(code, text, a, _moved(a, along)) for a in (0, 2) for code, text, along in MOVED]
    for code, text, a, turn in TURNED:
        out.append(Force(code, text, a, lambda r, m, f=turn: f(m.nu[:, 0], m.nu[:, 2])))
    return out


def _commanded(model: Any, j: int, most: float, along: Along) -> Phi:
    return lambda record, _: along(_channels(model, record.u)[:, j] / most, np.cumsum(record.dt_s))


def _moved(axis: int, along: Along) -> Phi:
    def phi(record: Record, motion: Motions) -> np.ndarray:
        nu = motion.nu[:, axis]
        return along(nu / max(float(np.max(np.abs(nu))), 1e-9), np.cumsum(record.dt_s))

    return phi


def _channels(model: Any, u: np.ndarray) -> np.ndarray:
    """w (N, k) of (2)."""
    drivetrain = getattr(model, "drivetrain", None)
    if getattr(drivetrain, "mixing", "none") == "two_wheels":
        return np.column_stack([u[:, 0] - u[:, 2], u[:, 0] + u[:, 2]])
    return u


def _since_turn(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """sign x e^(−s/0.2 s), s since x last changed its sign."""
    sign = np.sign(x)
    known = np.flatnonzero(sign != 0.0)
    turned = known[1:][sign[known[1:]] != sign[known[:-1]]] if len(known) else known
    if not len(turned):
        return np.zeros(len(x))
    last = np.searchsorted(turned, np.arange(len(x)), side="right") - 1
    since = np.where(last >= 0, t - t[turned[np.maximum(last, 0)]], np.inf)
    return np.exp(-since / AFTER_S) * sign


COMMANDED: tuple[tuple[str, str, Along], ...] = (
    ("dead zone", "a dead zone of the motors, or dry friction", lambda w, t: np.tanh(w / SMALL)),
    ("saturation", "motors that lose force at full command, or wheels that slip", lambda w, t: w * np.abs(w)),
    ("asymmetry", "motors that are not equal forward and backward", lambda w, t: np.abs(w)),
    ("fading", "a battery that fades", lambda w, t: w * (t / t[-1] - 0.5)),
    ("backlash", "backlash, or nothing pushes just after a command changes its sign", _since_turn),
)
MOVED: tuple[tuple[str, str, Along], ...] = (
    ("dry friction", "dry (Coulomb) friction", lambda v, t: np.tanh(v / SMALL)),
    ("drag", "drag that grows otherwise than in the model", lambda v, t: v * np.abs(v)),
    ("steep drag", "drag that grows otherwise than in the model", lambda v, t: v**3),
    ("one-sided drag", "friction that is not equal forward and backward", lambda v, t: np.abs(v)),
    ("caster", "a caster that flips when the motion turns round", _since_turn),
)
CORNER, OFF = "drag of cornering, or tyres that slip", "a centre of mass or an IMU off the axle"
TURNED: tuple[tuple[str, str, int, Along], ...] = (
    ("cornering", CORNER, 0, lambda x, w: x * np.abs(w)), ("cornering", CORNER, 2, lambda x, w: w * np.abs(x)),
    ("turning", OFF, 0, lambda x, w: w * w), ("turning", OFF, 2, lambda x, w: x * w),
    ("sideways", "tyres that slip sideways", 1, lambda x, w: x * w),
    ("sideways", "a sideways push of turning", 1, lambda x, w: w * np.abs(w)),
)  # fmt: skip


def _readings(
    blocks: Blocks, problem: Problem, record: Record, still: Motions
) -> list[tuple[str, str, np.ndarray]]:
    """(5)"""
    h = still.h
    h_dot = -np.gradient(h, axis=0) / np.maximum(record.dt_s, 1e-6)[:, None]
    found, at = [("delay", "a delay or lag between command and sensors", h_dot)], 0
    for name, block, size in zip(problem.names, blocks.sensors, problem.sizes, strict=True):
        span = slice(at, at + size)
        at += size
        if len(problem.names) > 1:
            own = np.zeros_like(h)
            own[:, span] = h_dot[:, span]
            found.append((f"delay of {name}", f"a clock of {name} that is off, or its delay", own))
        if hasattr(block, "lever_arm_m"):
            found += _mount(name, h, still, span)
    return found


def _mount(name: str, h: np.ndarray, still: Motions, span: slice) -> list[tuple[str, str, np.ndarray]]:
    """An IMU elsewhere, turned, or with the other measurement model."""
    x, y = span.start, span.start + 1
    w, w_dot = still.nu[:, 2], still.nu_dot[:, 2]
    out = []
    for text, along, across in (
        (f"{name} sits ahead of or behind where the file says", -w * w, w_dot),
        (f"{name} sits beside where the file says", -w_dot, -w * w),
        (f"{name} is turned on its mount", h[:, y], -h[:, x]),
        (
            f"what {name} feels in turns is not of its measurement_model",
            -w * still.nu[:, 1],
            w * still.nu[:, 0],
        ),
    ):
        D = np.zeros_like(h)
        D[:, x], D[:, y] = along, across
        out.append((f"mount of {name}", text, D))
    return out
