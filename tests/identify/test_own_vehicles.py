"""The vehicles of examples/, each a user class, work like built-in vehicles in fits, term choice and design.

The data come from simple simulations in this file, which share nothing with the classes: finer steps, and dry
friction that sticks.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from baqueano.block_checks import check
from baqueano.design.plan import design_plan
from baqueano.identify import FitOptions, identify, random_steps
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.noise.covariances import measure_noise
from baqueano.messages import texts
from baqueano.routes.room import vehicle_room
from baqueano.runs.run import Channel, Run
from baqueano.selection.choose import choose
from baqueano.selection.terms import vehicle_terms
from baqueano.simulate import simulate
from baqueano.vehicle_file import load

EXAMPLES = Path(__file__).parents[2] / "examples"
AXIS = {"gain": 1.3, "damping": 14.0, "rail": 2.2}
OMNI = {"inertia_kg_m2": 0.031, "push": 4.2, "drag": 7.0, "rollers": 0.35}
FINE = 5  # integration steps of the truth per tick


def load_run(file, u, z):
    """Return a run of the commands u (N, n) and of the readings of the only sensor (N, m) at the end of each tick."""
    t_ns = np.round(np.arange(1, len(u) + 1) * 1e9 / file.rate_hz).astype(np.int64)
    (name,) = file.sensors._fields
    return Run("a run of its own", None, t_ns, u, sensors={name: Channel(t_ns, t_ns, z)})


def carriage(volts, rate_hz, rng):
    """Return the encoder speed (N, 1) of a carriage on a rail that sticks; exact while it moves in one direction."""
    k, d, c = AXIS.values()
    v, fade, out = 0.0, np.exp(-d / rate_hz / FINE), []
    for u in volts:
        for _ in range(FINE):
            sign = np.sign(v) if v else np.sign(u) * (abs(k * u) > c)
            end = (k * u - c * sign) / d
            v = (end + (v - end) * fade) if sign else 0.0
            v = 0.0 if v * sign < 0.0 else v
        out.append(v + 0.01 * rng.standard_normal())
    return np.array(out)[:, None]


def omni(duties, rate_hz, rng, m=2.0, R=0.14):
    """Return (a_x, a_y, ω) (N, 3) of an IMU in the middle of a robot with wheels at 60, 180 and 300 degrees. The
    integration uses the midpoint rule."""
    h, nu, out = 1.0 / rate_hz / FINE, np.zeros(3), []
    rims = np.array([[-np.sin(a), np.cos(a), R] for a in np.radians([60.0, 180.0, 300.0])])

    def push(nu, u):
        rim = rims @ nu
        F = OMNI["push"] * u - OMNI["drag"] * rim - OMNI["rollers"] * np.tanh(rim / 0.05)
        return (F @ rims) / [m, m, OMNI["inertia_kg_m2"]]

    def nu_dot(nu, u):
        return push(nu, u) + np.array([nu[2] * nu[1], -nu[2] * nu[0], 0.0])

    for u in duties:
        for _ in range(FINE):
            nu = nu + h * nu_dot(nu + 0.5 * h * nu_dot(nu, u), u)
        out.append([*push(nu, u)[:2], nu[2]])
    return np.array(out) + rng.standard_normal((len(duties), 3)) * [0.05, 0.05, 0.005]


def of_axis(file, seed=0, seconds=8.0, u=None):
    u = random_steps([12.0], seconds, file.rate_hz, seed) if u is None else u
    return load_run(file, u, carriage(u[:, 0], file.rate_hz, np.random.default_rng(seed)))


def of_omni(file, seed=0, seconds=16.0, u=None):
    u = random_steps([0.7, 0.7, 0.7], seconds, file.rate_hz, seed) if u is None else u
    return load_run(file, u, omni(u, file.rate_hz, np.random.default_rng(seed)))


CASES = {"servo_axis": (of_axis, AXIS, "2x2"), "omni_robot": (of_omni, OMNI, "3x3")}


@pytest.fixture(scope="module")
def files():
    return {name: load(EXAMPLES / f"{name}.toml") for name in CASES}


@pytest.fixture(scope="module")
def fits(files):
    return {name: identify(drive(files[name]), files[name]) for name, (drive, _, _) in CASES.items()}


@pytest.mark.parametrize("name", CASES)
def test_each_example_class_has_at_most_forty_lines_and_passes_the_check(files, name):
    lines = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8").splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("@dataclass"))
    assert len(lines) - begin <= 40
    assert check("vehicle", files[name].vehicle) == []


@pytest.mark.parametrize("name", CASES)
def test_unmeasured_parameters_are_free_by_default_and_estimated_within_their_intervals(fits, name):
    fit, truth = fits[name], CASES[name][1]
    assert fit.names == tuple(f"model.{key}" for key in truth)
    z = (fit.estimate - np.array(list(truth.values()))) / fit.std
    assert np.max(np.abs(z)) < 3.0  # by chance in 2 % of all seeds
    assert fit.verdict == "USABLE", fit.reasons


@pytest.mark.parametrize("name", CASES)
def test_a_drive_is_designed_for_the_parameters_of_a_custom_vehicle(files, name):
    file, truth, room = files[name], *CASES[name][1:]
    plan = design_plan(file, vehicle_room(file, room), 2.0, progress=lambda text: True)
    assert plan.names == tuple(f"model.{key}" for key in truth)
    assert np.max(plan.relative_std) < 0.2
    assert plan.margin_m > 0.0


@pytest.mark.parametrize(
    ("name", "term", "terms"),
    [("servo_axis", "dry friction of the rail", ["dead zone forward"]),
     ("omni_robot", "dry friction of the rollers", [])],
)  # fmt: skip
def test_terms_named_in_the_metadata_of_a_custom_vehicle_are_chosen(files, name, term, terms):
    run = CASES[name][0](files[name], 0, 13.0)
    assert choose(run, files[name], [term, *terms]).selected_terms == (term,)


def test_a_dead_zone_of_two_volts_hides_no_model_term(files):
    zones = {f"model.drivetrain.dead_zone_{sign}": [2.0] for sign in ("forward", "backward")}
    file = files["servo_axis"].with_values(zones)
    names = [
        term.name
        for term in vehicle_terms(FittedBlocks(file.vehicle, file.sensors), np.array([[1.0], [-1.0]]))
    ]
    assert names[:2] == ["dry friction of the rail", "dead zone"]


def test_unobservable_parameters_are_reported_with_their_metadata_texts(files):
    file = files["servo_axis"]
    fit = identify(of_axis(file, u=np.full((3000, 1), 12.0)), file)
    assert "slow strokes that stop and turn, many times" in " ".join(texts(fit.findings))
    file, u = files["omni_robot"], random_steps([0.7], 8.0, 100.0, 0) * [1.0, 0.0, -1.0]
    fit = identify(of_omni(file, u=u), file)
    remedies = texts(reason for reason in fit.unobservable if reason.subject == "model.inertia_kg_m2")
    assert any("turning on the spot, to and fro" in remedy for remedy in remedies)
    fit = identify(of_omni(file), file, ["+model.mass_kg"], options=FitOptions(diagnose=False))
    (mass,) = (reason for reason in fit.unobservable if reason.subject == "model.mass_kg")
    assert (mass.code, mass.figures["advice"].code) == (
        "identifiability.collinear",
        "identifiability.measure",
    )


@pytest.mark.parametrize(
    ("volts", "speed", "code"),
    [(-1.0, 1.0, "axes.inverted"), (1.0, 1e3, "file.far-gain"), (255.0 / 12.0, 1.0, "command.unit")],
)  # fmt: skip
def test_a_gain_of_wrong_sign_or_unit_is_refused(files, volts, speed, code):
    run = of_axis(files["servo_axis"], 1, 4.0)
    encoder = run.sensors["encoder"]
    sensors = {"encoder": encoder._replace(z=speed * encoder.z)}
    fit = identify(
        replace(run, applied_commands=volts * run.applied_commands, sensors=sensors), files["servo_axis"]
    )
    assert fit.verdict == "REFUSED"
    assert fit.reasons[0].code == code


def test_the_noise_covariance_is_positive_definite_on_axes_without_motion(files, fits):
    """Without motion the covariance had a zero eigenvalue, and `identify` ended with an error."""
    file = files["servo_axis"]
    run = simulate(file, random_steps([12.0], 4.0, file.rate_hz, 0))
    for recording in (run, replace(run, truth=None)):
        R = measure_noise(fits["servo_axis"], recording).process
        assert np.all(np.linalg.eigvalsh(R) > 0.0)
        assert R[0, 0] > 100.0 * R[1, 1]
