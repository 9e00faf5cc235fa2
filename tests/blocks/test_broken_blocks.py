"""Blocks that are broken on purpose, one way each, and the sentence that their author reads."""

import pytest

from .students import FROZEN, GOOD, sentences_about

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
        "wrap((estimate.t_ns - state) * 1e-9)",
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
    "time since 0 in an estimator": (
        "estimator",
        "Belief(-1, np",
        "Belief(0, np",
        ["gives another cov when the clock begins at 1.7e+18 ns", "Keep t_ns in the state, -1 before"],
    ),
    "time since 0 in a guide": (
        "guide",
        "np.where(state < 0, estimate.t_ns, state)",
        "0",
        "gives another psi when the clock begins at 1.7e+18 ns, a time since 1970",
    ),
    "time since 0 in a controller": (
        "controller",
        "0.0, e[2]])",
        "0.0, e[2] * np.minimum(estimate.t_ns * 1e-9, 60.0)])",
        "gives another u when the clock begins at 1.7e+18 ns",
    ),
    "an error at an epoch": (
        "controller",
        "        e = pose_error",
        "        np.zeros(100)[estimate.t_ns // 10**12]\n        e = pose_error",
        ["Block.step() raises IndexError: ", "(with a clock that begins at 1.7e+18 ns)."],
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
    "moves by itself": ("vehicle", "e[0], 0.0", "e[0] + 0.1, 0.0", "within 2 s without a command"),
    "gains speed": ("vehicle", "e[1]]) - nu", "e[1]]) + nu", "gains speed without a command"),
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
def test_id12_what_the_author_reads(tmp_path, case):
    room, old, new, parts = BROKEN[case]
    assert GOOD[room].count(old) >= 1
    sentences = sentences_about(tmp_path, room, GOOD[room].replace(old, new, 1))
    assert sentences
    for part in [parts] if isinstance(parts, str) else parts:
        assert any(part in sentence for sentence in sentences), sentences
    assert all(sentence.startswith("mine.py line ") for sentence in sentences)
