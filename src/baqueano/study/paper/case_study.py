"""Reproduce case study I of the paper, with the errors of paper and baqueano, and check the values of case study II.

The vehicle, the excitation and the noise are from garage/case-study-1. Simulation and fit use the paper's accelerometer
(errata 3). Rows have the paper's signs: its friction coefficients are negative.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.diagnostics import Verdict
from baqueano.identify import Fit, FitOptions, excitation, identify
from baqueano.messages import texts
from baqueano.messages.language import number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.runs import Run
from baqueano.simulate import simulate
from baqueano.sweep.workers import run_in_processes
from baqueano.vehicle_file import VehicleFile, load

SECONDS = 60.0
HOLD_S = 1.0
AXES = ("x", "y", "psi")
FREE = ("model.friction.linear", "model.friction.quadratic", "model.actuator_matrix")
START_VALUES = {  # half of the truth, and no cross-talk
    "model.friction.linear": [3.5, 3.5, 250.0],
    "model.friction.quadratic": [1.75, 1.75, 125.0],
    "model.actuator_matrix[0,0]": 0.5,
    "model.actuator_matrix[2,2]": 15.0,
}
PRINTED_VALUES = {  # the paper's estimates, as printed
    "d_lx": -7.511, "d_ly": -6.4657, "d_lpsi": -411.7147,
    "d_cx": 3.4398, "d_cy": -4.6451, "d_cpsi": -313.1575,
    "T_11": 0.98720, "T_12": 0.0, "T_13": 0.017941,
    "T_21": -0.00023045, "T_22": 0.0, "T_23": -0.0000411,
    "T_31": -1.244, "T_32": 0.0, "T_33": 29.29,
}  # fmt: skip


def paper_parameters() -> Iterator[tuple[str, str, float]]:
    """Yield (the paper's name, path in the vehicle file, sign between them) for each parameter."""
    for letter, field in (("l", "linear"), ("c", "quadratic")):
        for k, axis in enumerate(AXES):
            yield f"d_{letter}{axis}", f"model.friction.{field}[{k}]", -1.0
    for i in range(3):
        for j in range(3):
            yield f"T_{i + 1}{j + 1}", f"model.actuator_matrix[{i},{j}]", 1.0


def simulate_seed(seed: int, backend: str = "auto") -> tuple[VehicleFile, Run]:
    """Return the vehicle of case study I and its run of 60 s of random steps, each held for 1 s."""
    vehicle = load("case-study-1")
    u = excitation("random_steps", vehicle.command.limit, SECONDS, vehicle.rate_hz, seed, hold_s=HOLD_S)
    return vehicle, simulate(vehicle, u, seed, name=f"case study I, seed {seed}", backend=backend)


def fit_seed(seed: int, backend: str = "auto") -> Fit:
    """Return the dynamic model fitted to the run of `seed`: from rest, with an IMU without bias, as in the paper."""
    vehicle, run = simulate_seed(seed, backend)
    return identify(
        run,
        vehicle,
        FREE,
        options=FitOptions(start=START_VALUES, biases=False, at_rest=True, backend=backend),
    )


@dataclass(frozen=True)
class CaseStudy(Result):
    """Fits of case study I at one seed or several; the table shows the first fit."""

    fits: tuple[Fit, ...]
    seeds: tuple[int, ...]

    def rows(self) -> list[TableRow]:
        """Return name, truth, paper, estimate and std in the paper's signs; None if it is not identifiable."""
        return [
            {"name": name, "truth": truth, "paper": PRINTED_VALUES[name], "estimate": estimate, "std": std}
            for name, truth, estimate, std in self._values(self.fits[0])
        ]

    def _values(self, fit: Fit) -> Iterator[tuple[str, float, float | None, float | None]]:
        for name, path, sign in paper_parameters():
            truth = sign * float(fit.file.value(path)) + 0.0
            k = fit.names.index(path)
            identifiable = bool(np.isfinite(fit.estimate[k]) and np.isfinite(fit.std[k]))
            yield (
                name,
                truth,
                sign * float(fit.estimate[k]) if identifiable else None,
                float(fit.std[k]) if identifiable else None,
            )

    @property
    def normalised_errors(self) -> np.ndarray:
        """Return (estimate − truth) / std of all observable parameters of all seeds."""
        values = (value for fit in self.fits for value in self._values(fit))
        return np.array([(e - t) / std for _, t, e, std in values if e is not None and std])

    @property
    def share_within_interval(self) -> float:
        """Return the fraction of the parameters within 1.96 standard errors of the truth."""
        return float(np.mean(np.abs(self.normalised_errors) <= 1.96))

    @property
    def verdict(self) -> Verdict:
        """Return the verdict of the first fit, or WARN if it is USABLE and an error exceeds 4.5 standard errors."""
        verdict = self.fits[0].verdict
        if verdict == Verdict.USABLE and np.abs(self.normalised_errors).max() > 4.5:
            return Verdict.WARN
        return verdict

    def table(self) -> str:
        """Return a text table with the errors of the paper and of the first fit, in per cent of the truth."""
        head = ["", _("truth"), _("paper"), _("its error"), _("ours"), _("std. error"), _("our error")]
        rows = []
        for row in self.rows():
            truth, estimate = row["truth"], row["estimate"]
            value = (
                [_("not identifiable"), ""]
                if estimate is None
                else [f"{number(estimate):.5g}", f"{number(row['std']):.2g}"]
            )
            paper = [f"{number(truth):.4g}", f"{number(row['paper']):.5g}", _error(row["paper"], truth)]
            rows.append([row["name"], *paper, *value, _error(estimate, truth)])
        lines = [
            _("Case study I, {seconds:.0f} s, seed {seed}", seconds=SECONDS, seed=self.seeds[0]),
            *text_table("<>>>>>>", head, *rows),
        ]
        lines += ["", *texts(self.fits[0].unobservable), *texts(self.fits[0].always_unobservable)]
        lines.append(
            _("largest deviation {largest:.1f} standard errors", largest=np.abs(self.normalised_errors).max())
        )
        if len(self.fits) > 1:
            lines.append(
                _(
                    "over {seeds} seeds {inside:.1f} % lie within 1.96 standard errors",
                    seeds=len(self.fits),
                    inside=100 * self.share_within_interval,
                )
            )
        return "\n".join([*lines, _("verdict: {verdict}", verdict=_(self.verdict))])


def _error(value: float | None, truth: float) -> str:
    """Return the error in per cent of the truth, or the value if the truth is zero."""
    if value is None:
        return ""
    if truth == 0.0:
        return f"{number(value):+.2g}"
    return f"{number(100 * (value - truth) / abs(truth)):+.2f} %"


def case_study(
    seed: int = 0, seeds: int = 1, backend: str = "auto", advance: Callable[[int], None] | None = None
) -> CaseStudy:
    """Return the fits of case study I at `seeds` seeds from `seed` on. `advance` is called with the number of fits
    that have just finished. Ctrl-C ends the study with the finished fits. It raises KeyboardInterrupt before the
    first fit.
    """
    seed_range = tuple(range(seed, seed + seeds))
    fits = run_in_processes(lambda s: fit_seed(s, backend), seed_range, advance=advance)
    if not fits:
        raise KeyboardInterrupt
    return CaseStudy(tuple(fits), seed_range[: len(fits)])


@dataclass(frozen=True)
class ImpliedParameters:
    """The printed values of case study II, and their consequences."""

    mass_kg: float = 0.61
    radius_m: float = 0.07
    inertia: float = 669.12
    d_lx: float = 11.9173
    T_11: float = 0.6984
    T_33: float = 0.000965

    def rows(self) -> list[TableRow]:
        """Return a row for each printed value: its consequence and the expected value."""
        disc = 0.5 * self.mass_kg * self.radius_m**2
        gyration = np.sqrt(self.inertia / self.mass_kg)
        turning, with_disc = self.T_33 / self.inertia, self.T_33 / disc
        figures = (
            (
                f"I = {self.inertia}",
                _("a radius of gyration of {gyration:.1f} m", gyration=gyration),
                _("½ m R² = {disc:.3g} kg m² (a disc of {radius_m} m)", disc=disc, radius_m=self.radius_m),
            ),
            (
                f"d_lx = -{self.d_lx}",
                _("a time constant m/d of {ms:.0f} ms", ms=1000 * self.mass_kg / self.d_lx),
                _("as small gear motors have"),
            ),
            (
                f"T_11 = {self.T_11}",
                _("{speed:.3f} m/s per unit of u_x", speed=self.T_11 / self.d_lx),
                _("0.4 to 0.7 m/s at full command: u is not a duty in [-1, 1]"),
            ),
            (
                f"T_33 = {self.T_33}",
                _(
                    "{turning:.2g} rad/s² per unit of u_psi with that I, {with_disc:.2g} with the disc's",
                    turning=turning,
                    with_disc=with_disc,
                ),
                _("tens of rad/s² at full command"),
            ),
            ("d_l[2], d_c", _("missing in the text"), _("one value each")),
        )
        return [dict(zip(("printed", "implies", "expected"), row, strict=True)) for row in figures]

    def table(self) -> str:
        """Return the printed values, their consequences and the expected values as text."""
        lines = (_("  {printed:<24} {implies}; expected {expected}", **row) for row in self.rows())
        return "\n".join([_("Case study II, as printed"), *lines])
