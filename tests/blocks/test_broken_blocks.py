"""Each broken block has one deliberate fault; the block check must report its codes and figures."""

import pytest

from .students import GOOD, findings_about

BROKEN = {
    "it can be changed": (
        "controller",
        "@dataclass(frozen=True, slots=True, eq=False)\n",
        "",
        [("check.not-frozen", {})],
    ),
    "imports time": (
        "controller",
        "import numpy",
        "import time\n\nimport numpy",
        [("outside.imports", {"name": "time"})],
    ),
    "imports from os": (
        "guide",
        "import numpy",
        "from os import path\n\nimport numpy",
        [("outside.imports", {"name": "os"})],
    ),
    "random numbers": (
        "controller",
        "self.gain * e[0]",
        "e[0] + np.random.normal()",
        [("outside.draws", {}), ("check.not-deterministic", {})],
    ),
    "prints": (
        "guide",
        "        psi =",
        "        print(1)\n        psi =",
        [("outside.calls", {"name": "print"})],
    ),
    "global": (
        "controller",
        "        e = pose_error",
        "        global LAST\n        LAST = estimate\n        e = pose_error",
        [("outside.global", {"name": "LAST", "advice": "outside.state"})],
    ),
    "remembers in itself": (
        "controller",
        "        e = pose_error",
        "        object.__setattr__(self, 'gain', self.gain + 1.0)\n        e = pose_error",
        [("check.block-changed", {"situation": "when.circle"})],
    ),
    "changes an argument": (
        "controller",
        "        e = pose_error",
        "        estimate.eta[0] = 0.0\n        e = pose_error",
        [("check.changes-arguments", {"situation": "when.circle"})],
    ),
    "raises": (
        "controller",
        "        e = pose_error(reference.eta, estimate.eta)",
        "        e = reference.eta @ np.zeros(4)",
        [
            ("check.raises-on-line", {"subject": "Block.step()"}),
            ("check.raises-on-line", {"line": 20, "situation": "when.circle"}),
        ],
    ),
    "raises at the start": (
        "controller",
        "return 0.0",
        "return 1 / 0",
        [("check.raises-on-line", {"subject": "Block.init()"})],
    ),
    "no init": ("controller", "def init", "def start", [("check.no-method", {"name": "init"})]),
    "no pair": (
        "controller",
        "return state + 1.0, Command",
        "return Command",
        [("check.two-values", {"value": "Command", "situation": "when.circle", "subject": "Block.step()"})],
    ),
    "yield in place of return": (
        "controller",
        "return state + 1.0, Command",
        "yield state + 1.0, Command",
        [("check.no-function", {"value": "generator", "subject": "Block.step()"})],
    ),
    "async": ("controller", "def step", "async def step", [("check.no-function", {"value": "coroutine"})]),
    "one value": (
        "controller",
        "return state + 1.0, Command(estimate.t_ns, u)",
        "return u",
        [("check.two-values", {"value": "ndarray"})],
    ),
    "no command": (
        "controller",
        "Command(estimate.t_ns, u)\n",
        "u\n",
        [("check.returns", {"value": "ndarray"})],
    ),
    "wrong shape": (
        "controller",
        "[self.gain * e[0], 0.0, e[2]]",
        "[e[0], e[2]]",
        [("check.shape", {"value": "(2,)", "shape": "(3,)"})],
    ),
    "words": (
        "controller",
        "Command(estimate.t_ns, u)\n",
        'Command(estimate.t_ns, "left")\n',
        [("check.no-numbers", {"field": "Command.u", "value": "str"})],
    ),
    "nan": (
        "controller",
        "self.gain * e[0]",
        "np.sqrt(-1.0 - e[0] ** 2)",
        [("check.not-finite", {"field": "Command.u"})],
    ),
    "divides by the speed of its reference": (
        "controller",
        "self.gain * e[0]",
        "self.gain * e[0] / reference.nu[0]",
        [("check.not-finite", {"field": "Command.u", "situation": "when.rest"})],
    ),
    "no stamp": (
        "controller",
        "Command(estimate.t_ns",
        "Command(0",
        [("check.stamp", {"value": 0, "signal": "estimate"})],
    ),
    "complex numbers": (
        "controller",
        "self.gain * e[0]",
        "1j * e[0]",
        [("check.no-numbers", {"field": "Command.u"})],
    ),
    "digits in quotes": (
        "controller",
        "Command(estimate.t_ns, u)",
        'Command(estimate.t_ns, ["1", "2", "3"])',
        [("check.no-numbers", {"value": "list"})],
    ),
    "a number that is too large": (
        "controller",
        "[self.gain * e[0], 0.0, e[2]]",
        "[10**400, 0.0, e[2]]",
        [("check.no-numbers", {"field": "Command.u"})],
    ),
    "a word as stamp": (
        "controller",
        "Command(estimate.t_ns",
        'Command("now"',
        [("check.stamp", {"value": "now"}), ("check.stamp", {"value": "now"})],
    ),
    "a word as end": (
        "guide",
        "return state, Reference(",
        'return state, Reference(estimate.t_ns, np.zeros(3), np.zeros(3), "yes") if True else (',
        [("check.no-numbers", {"field": "Reference.at_end", "value": "str"})],
    ),
    "map frame": (
        "controller",
        "pose_error(reference.eta, estimate.eta)",
        "reference.eta - estimate.eta",
        [("check.full-turn", {})],
    ),
    "not turned": (
        "controller",
        "pose_error(reference.eta, estimate.eta)",
        "wrap(reference.eta - estimate.eta)",
        [("check.world-moved", {})],
    ),
    "divides by no time": (
        "controller",
        "e[2]])",
        "e[2] / (estimate.t_ns - state)])\n        state = estimate.t_ns - 1.0",
        [("check.not-finite", {"situation": "when.repeated"})],
    ),
    "not wrapped": (
        "estimator",
        "wrap(eta[2])",
        "eta[2]",
        [("check.not-wrapped", {"field": "Estimate.eta[2]", "situation": "when.circle"})],
    ),
    "covariance asymmetric": (
        "estimator",
        "dt * np.eye(6)\n        return",
        "dt * np.triu(np.ones((6, 6)))\n        return",
        [("check.not-symmetric", {"field": "Estimate.cov", "situation": "when.circle"})],
    ),
    "covariance negative": (
        "estimator",
        "belief.cov + dt",
        "belief.cov - 1e3 * dt",
        [("check.eigenvalue", {"smallest": -19.0})],
    ),
    "never less sure": (
        "estimator",
        "belief.cov + dt * np.eye(6)",
        "belief.cov",
        [("check.constant-covariance", {})],
    ),
    "believes a nan": (
        "estimator",
        "np.where(np.isfinite(z[2]), z[2], 0.0)",
        "z[2]",
        [("check.not-finite", {"situation": "when.after-measurement"})],
    ),
    "no estimate": (
        "estimator",
        "Estimate(tick.t_ns, eta, np.zeros(3), cov)",
        "eta",
        [("check.returns", {})],
    ),
    "estimator needs its sensor": (
        "estimator",
        "omega = np.where(np.isfinite(z[2]), z[2], 0.0)",
        "omega = 1.0 / z[2] * z[2] if z[2] else 1 / 0",
        [
            (
                "check.raises-on-line",
                {"error": "ZeroDivisionError: division by zero", "line": 26, "situation": "when.silent"},
            )
        ],
    ),
    "guide not wrapped": (
        "guide",
        "wrap((estimate.t_ns - state) * 1e-9)",
        "2.0 * estimate.t_ns * 1e-9",
        [("check.not-wrapped", {"field": "Reference.eta[2]", "psi_rad": 3.16})],
    ),
    "guide says maybe": (
        "guide",
        "np.zeros(3), 0.0)",
        "np.zeros(3), 0.5)",
        [("check.at-end", {"value": "0.5"})],
    ),
    "guide ends": (
        "guide",
        "        psi =",
        "        1 / max(0, 2 * 10**12 - estimate.t_ns)\n        psi =",
        [("check.raises-on-line", {"situation": "when.later"})],
    ),
    "reference jumps by 2 m after 6 s": (
        "guide",
        "np.array([0.0, 0.0, psi])",
        "np.array([2.0 * (estimate.t_ns - state > 6_000_000_000), 0.0, psi])",
        [("check.jump", {"step_m": 2.0})],
    ),
    "guide returns a pose": ("guide", "return state, Reference(", "return state, (", [("check.returns", {})]),
    "lets a nan through": (
        "supervisor",
        "np.where(bad > 0.0, 0.0, ",
        "np.where(False, 0.0, ",
        [("check.not-finite", {"field": "Command.u", "value": "[nan, nan, nan]"})],
    ),
    "lets a blind vehicle drive": (
        "supervisor",
        " + np.sum(estimate.eta)",
        "",
        [("check.nan-output", {"signal": "Estimate"})],
    ),
    "drives on": (
        "supervisor",
        "state, 1.0)",
        "0.0, 1.0)",
        [("check.stop-not-latched", {"signal": "Command"})],
    ),
    "no limit": (
        "supervisor",
        "np.clip(command.u, -self.limit, self.limit)",
        "command.u",
        [("check.beyond-limit", {"limit": "1.0"})],
    ),
    "supervisor returns u": (
        "supervisor",
        "Command(command.t_ns, u)",
        "u",
        [("check.returns", {"expected": "(state, Command(t_ns, u))"})],
    ),
    "time since 0 in an estimator": (
        "estimator",
        "Belief(-1, np",
        "Belief(0, np",
        [("check.clock", {"name": "cov"}), ("check.clock", {})],
    ),
    "time since 0 in a guide": (
        "guide",
        "np.where(state < 0, estimate.t_ns, state)",
        "0",
        [("check.clock", {"name": "psi"})],
    ),
    "time since 0 in a controller": (
        "controller",
        "0.0, e[2]])",
        "0.0, e[2] * np.minimum(estimate.t_ns * 1e-9, 60.0)])",
        [("check.clock", {"name": "u"})],
    ),
    "an error at an epoch": (
        "controller",
        "        e = pose_error",
        "        np.zeros(100)[estimate.t_ns // 10**12]\n        e = pose_error",
        [
            ("check.raises-on-line", {"subject": "Block.step()"}),
            ("check.raises-on-line", {"situation": "when.clock"}),
        ],
    ),
    "no cov": ("sensor", "def cov", "def covariance", [("check.no-attribute", {"name": "cov"})]),
    "no field for a measured noise": (
        "sensor",
        "measurement_noise_cov",
        "noise_matrix",
        [("check.no-noise-field", {})],
    ),
    "cov of nothing": ("sensor", "0.01 * np.eye(1)", "np.zeros((1, 1))", [("check.no-noise", {})]),
    "h of another size": (
        "sensor",
        "motion.nu[:1]",
        "motion.nu[:2]",
        [("check.shape", {"field": "h", "value": "(2,)", "shape": "(1,)"})],
    ),
    "no slot": (
        "sensor",
        "Slot(1.0, ",
        "(1.0, ",
        [("check.returns", {"expected": "(state, Slot(is_new, z))"})],
    ),
    "half a measurement": ("sensor", "Slot(1.0, ", "Slot(0.5, ", [("check.is-new", {"value": "0.5"})]),
    "a word as novelty": (
        "sensor",
        "Slot(1.0, ",
        'Slot("yes", ',
        [("check.no-numbers", {"field": "Slot.is_new"})],
    ),
    "silent but speaking": ("sensor", "Slot(1.0, ", "Slot(0.0, ", [("check.not-new", {})]),
    "late": (
        "sensor",
        "rate_hz: float = 50.0",
        "rate_hz: float = 5.0",
        [("check.rate", {"count": 100, "duration_s": 2.0, "rate_hz": 5.0, "expected": 10.0})],
    ),
    "no drivetrain": ("vehicle", "    drivetrain = ", "    motors = ", [("check.no-drivetrain", {})]),
    "no commands": ("vehicle", "    commands = 2\n", "", [("check.no-commands", {})]),
    "moves by itself": ("vehicle", "e[0], 0.0", "e[0] + 0.1, 0.0", [("check.moves-by-itself", {})]),
    "gains speed": ("vehicle", "e[1]]) - nu", "e[1]]) + nu", [("check.gains-speed", {})]),
    "vehicle not wrapped": (
        "vehicle",
        "eta[1], wrap(eta[2])])",
        "eta[1], eta[2]])",
        [("check.not-wrapped", {"field": "Motion.eta[2]"})],
    ),
    "no motion": ("vehicle", "Motion(eta, nu, nu_dot, np.zeros(2))", "eta", [("check.returns", {})]),
    "advance of two": (
        "vehicle",
        "wrap(eta[2])]), nu, nu_dot",
        "wrap(eta[2])]), nu",
        [("check.raises-on-line", {})],
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_id12_each_broken_block_gives_the_expected_diagnostic_codes(tmp_path, case):
    room, old, new, expected = BROKEN[case]
    assert GOOD[room].count(old) >= 1
    findings = findings_about(tmp_path, room, GOOD[room].replace(old, new, 1))
    for code, figures in expected:
        same_code = [finding for finding in findings if finding.code == code]
        assert any(figures.items() <= figures_of(finding).items() for finding in same_code), findings
    assert all(finding.figures["place"].startswith("mine.py line ") for finding in findings)
    keys = [(f.code, f.subject, *map(f.figures.get, ("field", "signal", "name"))) for f in findings]
    assert len({*keys}) == len(keys), "a fault of many ticks is reported once"


def figures_of(diagnostic):
    """The figures with the subject, of a cause its code."""
    codes = {name: getattr(value, "code", value) for name, value in diagnostic.figures.items()}
    return codes | {"subject": diagnostic.subject}
