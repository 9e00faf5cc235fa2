"""Blocks that are broken on purpose, one way each, and the sentence that their author reads."""

import pytest

from baqueano.blocks import check, notes, resolve, room_of
from baqueano.errors import FileError, UsageError

HEAD = '''"""A block of a student."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baqueano.geometry import pose_error, wrap
from baqueano.signals import Command, Estimate, Motion, Reference, Slot


'''
FROZEN = "@dataclass(frozen=True, slots=True, eq=False)\n"

ESTIMATOR = (
    HEAD
    + """class Belief(NamedTuple):
    t_ns: int
    eta: np.ndarray
    cov: np.ndarray


"""
    + FROZEN
    + """class Block:
    def init(self):
        return Belief(0, np.zeros(3), np.eye(6))

    def step(self, belief, tick):
        dt = (tick.t_ns - belief.t_ns) * 1e-9
        z = tick.sensors.imu.z
        omega = np.where(np.isfinite(z[2]), z[2], 0.0)
        eta = belief.eta + dt * np.array([0.0, 0.0, omega])
        eta = np.array([eta[0], eta[1], wrap(eta[2])])
        cov = belief.cov + dt * np.eye(6)
        return Belief(tick.t_ns, eta, cov), Estimate(tick.t_ns, eta, np.zeros(3), cov)
"""
)

CONTROLLER = (
    HEAD
    + FROZEN
    + """class Block:
    gain: float = 2.0

    def init(self):
        return 0.0

    def step(self, state, reference, estimate):
        e = pose_error(reference.eta, estimate.eta)
        u = np.array([self.gain * e[0], 0.0, e[2]])
        return state + 1.0, Command(estimate.t_ns, u)
"""
)

GUIDE = (
    HEAD
    + FROZEN
    + """class Block:
    def init(self):
        return 0

    def step(self, state, estimate):
        psi = wrap(estimate.t_ns * 1e-9)
        return state, Reference(estimate.t_ns, np.array([0.0, 0.0, psi]), np.zeros(3), 0.0)
"""
)

SUPERVISOR = (
    HEAD
    + FROZEN
    + """class Block:
    limit: float = 1.0

    def init(self):
        return 0.0

    def step(self, state, command, tick, estimate):
        bad = np.where(np.isfinite(np.sum(command.u) + np.sum(estimate.eta)), state, 1.0)
        u = np.where(bad > 0.0, 0.0, np.clip(command.u, -self.limit, self.limit))
        return bad, Command(command.t_ns, u)
"""
)

SENSOR = (
    HEAD
    + FROZEN
    + """class Block:
    size: int = 1
    noise_size: int = 1
    rate_hz: float = 50.0
    delay_s: float = 0.0

    @property
    def cov(self):
        return 0.01 * np.eye(1)

    def h(self, motion):
        return motion.nu[:1]

    def init(self):
        return 0.0

    def step(self, state, motion, dt_s, noise):
        return state, Slot(1.0, self.h(motion) + 0.1 * noise)
"""
)

VEHICLE = (
    HEAD.replace("Slot\n", "Slot\nfrom baqueano.vehicles import Drivetrain, VehicleState\n")
    + FROZEN
    + """class Block:
    commands = 2
    drivetrain = Drivetrain(commands=2)

    def init(self, eta=None, nu=None):
        zero = np.zeros(3)
        return VehicleState(zero if eta is None else eta, zero if nu is None else nu, zero, None)

    def gravity(self, psi):
        return np.zeros(2)

    def advance(self, eta, nu, effort, dt_s):
        nu_dot = np.array([effort[0], 0.0, effort[1]]) - nu
        nu = nu + dt_s * nu_dot
        eta = eta + dt_s * nu
        return np.array([eta[0], eta[1], wrap(eta[2])]), nu, nu_dot

    def step(self, state, u, dt_s, noise):
        eta, nu, nu_dot = self.advance(state.eta, state.nu, u, dt_s)
        return VehicleState(eta, nu, nu_dot, None), Motion(eta, nu, nu_dot, np.zeros(2))
"""
)
GOOD = {
    "estimator": ESTIMATOR,
    "controller": CONTROLLER,
    "guide": GUIDE,
    "supervisor": SUPERVISOR,
    "sensor": SENSOR,
    "vehicle": VEHICLE,
}


def verdict(tmp_path, room, text):
    """The sentences about the class Block of a file."""
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    kind = resolve(room, "mine.py:Block", tmp_path)
    return check(room, kind())


@pytest.mark.parametrize("room", GOOD)
def test_a_good_block_is_passed_without_a_word(tmp_path, room):
    assert verdict(tmp_path, room, GOOD[room]) == []


@pytest.mark.parametrize("room", GOOD)
def test_the_room_is_told_by_the_class(tmp_path, room):
    (tmp_path / "mine.py").write_text(GOOD[room], encoding="utf-8")
    assert room_of(resolve(room, "mine.py:Block", tmp_path)) == room


BROKEN = {
    "it can be changed": (
        "controller",
        FROZEN,
        "",
        "can be changed after it is built: write @dataclass(frozen=True",
    ),
    "imports time": (
        "controller",
        "import numpy",
        "import time\n\nimport numpy",
        "mine.py line 6 imports time: time",
    ),
    "imports from os": (
        "guide",
        "import numpy",
        "from os import path\n\nimport numpy",
        "imports os: a block knows no",
    ),
    "random numbers": (
        "controller",
        "self.gain * e[0]",
        "e[0] + np.random.normal()",
        ["uses numpy's random numbers: noise comes from outside", "gives two answers to the same question"],
    ),
    "prints": (
        "guide",
        "        psi =",
        "        print(1)\n        psi =",
        "calls print(): a block prints nothing",
    ),
    "global": (
        "controller",
        "        e = pose_error",
        "        global LAST\n        LAST = estimate\n        e = pose_error",
        "writes the global LAST: what is remembered goes into the state",
    ),
    "remembers in itself": (
        "controller",
        "        e = pose_error",
        "        object.__setattr__(self, 'gain', self.gain + 1.0)\n        e = pose_error",
        "changes the block itself (in a circle): what is remembered goes into the state",
    ),
    "changes an argument": (
        "controller",
        "        e = pose_error",
        "        estimate.eta[0] = 0.0\n        e = pose_error",
        "changes its arguments (in a circle): make new arrays",
    ),
    "raises": (
        "controller",
        "        e = pose_error(reference.eta, estimate.eta)",
        "        e = reference.eta @ np.zeros(4)",
        ["Block.step() raises ValueError: ", " on line 20 (in a circle)."],
    ),
    "raises at the start": (
        "controller",
        "return 0.0",
        "return 1 / 0",
        "Block.init() raises ZeroDivisionError",
    ),
    "no init": ("controller", "def init", "def start", "has no init()."),
    "no pair": (
        "controller",
        "return state + 1.0, Command",
        "return Command",
        "Block.step() returns Command alone (in a circle): expected two, (state, output).",
    ),
    "one value": (
        "controller",
        "return state + 1.0, Command(estimate.t_ns, u)",
        "return u",
        "returns ndarray",
    ),
    "no command": (
        "controller",
        "Command(estimate.t_ns, u)\n",
        "u\n",
        "returns ndarray: expected (state, Command(",
    ),
    "wrong shape": (
        "controller",
        "[self.gain * e[0], 0.0, e[2]]",
        "[e[0], e[2]]",
        "u with shape (2,): expected (3,)",
    ),
    "words": (
        "controller",
        "Command(estimate.t_ns, u)\n",
        'Command(estimate.t_ns, "left")\n',
        "Command.u = str",
    ),
    "nan": ("controller", "self.gain * e[0]", "np.sqrt(-1.0 - e[0] ** 2)", "Command.u = [nan, 0.0, "),
    "no stamp": (
        "controller",
        "Command(estimate.t_ns",
        "Command(0",
        "stamps its output with 0 instead of estimate.t_ns",
    ),
    "map frame": (
        "controller",
        "pose_error(reference.eta, estimate.eta)",
        "reference.eta - estimate.eta",
        "gives another command when ψ of the reference is a full turn further: wrap the difference.",
    ),
    "not turned": (
        "controller",
        "pose_error(reference.eta, estimate.eta)",
        "wrap(reference.eta - estimate.eta)",
        "gives another command when the whole world is moved and turned",
    ),
    "divides by no time": (
        "controller",
        "e[2]])",
        "e[2] / (estimate.t_ns - state)])\n        state = estimate.t_ns - 1.0",
        "(at a repeated tick): expected finite numbers",
    ),
    "not wrapped": (
        "estimator",
        "wrap(eta[2])",
        "eta[2]",
        "Estimate.eta[2] = 3.15 rad (in a circle): expected it wrapped",
    ),
    "covariance asymmetric": (
        "estimator",
        "dt * np.eye(6)\n        return",
        "dt * np.triu(np.ones((6, 6)))\n        return",
        "Estimate.cov that is not symmetric (in a circle)",
    ),
    "covariance negative": ("estimator", "belief.cov + dt", "belief.cov - 1e3 * dt", "eigenvalue -19"),
    "never less sure": (
        "estimator",
        "belief.cov + dt * np.eye(6)",
        "belief.cov",
        "is as sure of its position after 2 s without any sensor as before",
    ),
    "believes a nan": (
        "estimator",
        "np.where(np.isfinite(z[2]), z[2], 0.0)",
        "z[2]",
        "(after a measurement of NaN): expected finite numbers",
    ),
    "no estimate": (
        "estimator",
        "Estimate(tick.t_ns, eta, np.zeros(3), cov)",
        "eta",
        "expected (belief, Estimate(",
    ),
    "estimator needs its sensor": (
        "estimator",
        "omega = np.where(np.isfinite(z[2]), z[2], 0.0)",
        "omega = 1.0 / z[2] * z[2] if z[2] else 1 / 0",
        "ZeroDivisionError: division by zero on line 26 (while all sensors are silent)",
    ),
    "guide not wrapped": (
        "guide",
        "wrap(estimate.t_ns * 1e-9)",
        "2.0 * estimate.t_ns * 1e-9",
        "Reference.eta[2] = 3.16",
    ),
    "guide says maybe": (
        "guide",
        "np.zeros(3), 0.0)",
        "np.zeros(3), 0.5)",
        "says done = 0.5: expected 1.0 when",
    ),
    "guide ends": (
        "guide",
        "        psi =",
        "        1 / max(0, 2 * 10**12 - estimate.t_ns)\n        psi =",
        "an hour later",
    ),
    "guide returns a pose": (
        "guide",
        "return state, Reference(",
        "return state, (",
        "expected (state, Reference(",
    ),
    "lets a nan through": (
        "supervisor",
        "np.where(bad > 0.0, 0.0, ",
        "np.where(False, 0.0, ",
        "Command.u = [nan, nan, nan]",
    ),
    "lets a blind vehicle drive": (
        "supervisor",
        " + np.sum(estimate.eta)",
        "",
        "through after an estimate of NaN: expected zeros",
    ),
    "drives on": (
        "supervisor",
        "state, 1.0)",
        "0.0, 1.0)",
        "lets the vehicle drive again by itself after a command of NaN: a stop is for good",
    ),
    "no limit": (
        "supervisor",
        "np.clip(command.u, -self.limit, self.limit)",
        "command.u",
        "beyond its limit 1.0",
    ),
    "supervisor returns u": (
        "supervisor",
        "Command(command.t_ns, u)",
        "u",
        "expected (state, Command(t_ns, u))",
    ),
    "no cov": ("sensor", "def cov", "def covariance", "has no cov."),
    "cov of nothing": ("sensor", "0.01 * np.eye(1)", "np.zeros((1, 1))", "has a cov with 0 on its diagonal"),
    "h of another size": (
        "sensor",
        "motion.nu[:1]",
        "motion.nu[:2]",
        "gives h with shape (2,): expected (1,)",
    ),
    "no slot": ("sensor", "Slot(1.0, ", "(1.0, ", "expected (state, Slot(has, z))"),
    "half a measurement": (
        "sensor",
        "Slot(1.0, ",
        "Slot(0.5, ",
        "says has = 0.5: expected 1.0 where a measurement",
    ),
    "silent but speaking": ("sensor", "Slot(1.0, ", "Slot(0.0, ", "its z must be zeros then"),
    "late": (
        "sensor",
        "rate_hz: float = 50.0",
        "rate_hz: float = 5.0",
        "answers 100 times in 2 s: rate_hz = 5 promises 10",
    ),
    "no drivetrain": (
        "vehicle",
        "    drivetrain = ",
        "    motors = ",
        "has no drivetrain: estimators ask it",
    ),
    "no commands": (
        "vehicle",
        "    commands = 2\n",
        "",
        "has no commands: write commands: ClassVar[int] = 3",
    ),
    "moves by itself": ("vehicle", "effort[0], 0.0", "effort[0] + 0.1, 0.0", "within 2 s without a command"),
    "gains speed": ("vehicle", "effort[1]]) - nu", "effort[1]]) + nu", "gains speed without a command"),
    "vehicle not wrapped": ("vehicle", "eta[1], wrap(eta[2])])", "eta[1], eta[2]])", "Motion.eta[2] = 3."),
    "no motion": ("vehicle", "Motion(eta, nu, nu_dot, np.zeros(2))", "eta", "expected (state, Motion("),
    "advance of two": (
        "vehicle",
        "wrap(eta[2])]), nu, nu_dot",
        "wrap(eta[2])]), nu",
        "raises ValueError: not enough",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_the_author_reads(tmp_path, case):
    room, old, new, parts = BROKEN[case]
    assert GOOD[room].count(old) >= 1
    sentences = verdict(tmp_path, room, GOOD[room].replace(old, new, 1))
    assert sentences
    for part in [parts] if isinstance(parts, str) else parts:
        assert any(part in sentence for sentence in sentences), sentences
    assert all(sentence.startswith("mine.py line ") for sentence in sentences)


def test_a_class_that_fits_no_room_is_told_what_the_rooms_ask(tmp_path):
    (tmp_path / "mine.py").write_text(
        "class Block:\n    def step(self, state, world):\n        pass\n", encoding="utf-8"
    )
    with pytest.raises(
        FileError, match=r"mine\.py line 1 Block\.step\(state, world\) fits no room: expected"
    ):
        room_of(resolve("guide", "mine.py:Block", tmp_path))


def test_a_class_without_step_is_no_block(tmp_path):
    (tmp_path / "mine.py").write_text("class Block:\n    pass\n", encoding="utf-8")
    with pytest.raises(FileError, match=r"Block has no step\(\): every block has init\(\) and step"):
        room_of(resolve("guide", "mine.py:Block", tmp_path))


def test_a_room_that_is_not_there_is_told():
    with pytest.raises(UsageError, match=r'no room "guides".*Did you mean guide\?'):
        resolve("guides", "repeat")


def test_a_kind_that_looks_like_a_file_is_told_how_to_write_it():
    with pytest.raises(FileError, match=r'A block of your own is written "file\.py:Class"'):
        resolve("guide", "mine.py")


def test_a_function_is_no_block():
    def step(state, estimate):
        return state, None

    sentences = check("guide", step)
    assert any("has no step()" in s for s in sentences)


@pytest.mark.parametrize("room", GOOD)
def test_a_block_in_plain_numpy_text_can_be_compiled(tmp_path, room):
    (tmp_path / "mine.py").write_text(GOOD[room], encoding="utf-8")
    assert notes(room, resolve(room, "mine.py:Block", tmp_path)()) == []


def test_a_block_that_decides_with_if_works_and_is_told_what_it_costs(tmp_path):
    text = CONTROLLER.replace(
        "        u = np", "        if e[0] > 0.5:\n            e = 0.5 * e\n        u = np"
    )
    assert verdict(tmp_path, "controller", text) == []
    (note,) = notes("controller", resolve("controller", "mine.py:Block", tmp_path)())
    assert note.startswith(
        "mine.py line 19: Block.step() works, but cannot be compiled, so simulations with it are slow"
    )
    assert "np.where" in note


def test_a_block_that_says_something_else_when_compiled_is_told_so(tmp_path):
    text = CONTROLLER.replace("return state + 1.0,", "return str(e[0]),")
    assert verdict(tmp_path, "controller", text) == []
    (note,) = notes("controller", resolve("controller", "mine.py:Block", tmp_path)())
    assert "gives other numbers when it is compiled" in note
