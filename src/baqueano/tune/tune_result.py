"""The result of `tune`, with checks of its reliability."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from baqueano.contracts.blocks import Controller, OwnBlock
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result
from baqueano.diagnostics import Diagnostic, Severity, Verdict, note
from baqueano.messages import verdict_line
from baqueano.messages.language import number, shown_unit, translate as _
from baqueano.messages.text_table import text_table
from baqueano.tune.cost import Weights
from baqueano.tune.margins import LoopMargins, loop_margins
from baqueano.tune.objective import DriveErrors
from baqueano.tune.search import Descent
from baqueano.tune.search_space import file_values

if TYPE_CHECKING:
    from baqueano.contracts.values import JsonObject, TableRow
    from baqueano.vehicle_file import VehicleFile

# factors on a gain, for the cost around the optimum
FACTORS = (0.5, 0.65, 0.8, 0.9, 1.0, 1.1, 1.25, 1.6, 2.0)
# below one of these margins, a small error of the model makes the loop oscillate: the drawn error of the delay is 10 ms
MIN_GAIN_MARGIN, MIN_DELAY_MARGIN_S = 1.5, 0.02
MIN_PHASE_MARGIN_RAD = np.radians(30.0)  # Åström and Murray, Feedback Systems, 2008, section 9.3
SMOOTHER, SMALL_JERK_M2 = 10.0, 0.01  # the suggested weight on jerks: factor, and weight instead of 0
AGREEMENT_TOLERANCE = 1e-3  # costs with a smaller relative difference are treated as equal


class Gain(NamedTuple):
    """A gain and its bounds."""

    name: str  # "alpha"
    unit: str
    value: float
    file_value: float  # NaN if the file lacked the gain
    low: float
    high: float
    bound_side: int  # −1 at the lower bound, +1 at the upper, else 0
    cost_at_lower_gain: float  # cost with 0.8 times the gain, relative to the least cost
    cost_at_higher_gain: float  # cost with 1.25 times the gain, relative to the least cost


class WorstCase(NamedTuple):
    """The largest cost over vehicles drawn from the covariance of the fit, which the search did not use."""

    draws: int  # vehicles of the search
    test_vehicles: int  # vehicles of the test
    cost: float  # [m²] with these gains
    nominal: float  # [m²] with the gains that are optimal for the file's own vehicle


class FreshSeeds(NamedTuple):
    """The cost with noise that the search did not use."""

    seeds: int
    cost: float  # [m²]
    search_cost: float  # with the noise of the search


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TuneResult(Result):
    """Gains, their cost, and the descents that found these gains.

    Attributes
    ----------
    vehicle_file : VehicleFile
        The vehicle file for which the gains were tuned.
    gains : tuple of Gain
        Each gain, its bounds and its effect on the cost.
    cost : float [m²]
        Cost of the whole drive.
    cost_before : float [m²]
        Cost with the gains of the file; NaN if the file lacked them.
    cost_uncontrolled : float [m²]
        Cost without any control.
    weights : Weights
        Settings of the cost.
    drive : DriveErrors
        Errors of a drive with these gains.
    descents : tuple of Descent
        The descents, the least cost first.
    history : ndarray (e, 2)
        For each evaluation, the number of its descent and its cost [no unit].
    loop : str
        "perfect pose" or "estimator in the loop".
    backend : str
        Backend of the kernels.
    controller : Controller
        The block with these gains.
    kind : str, type, block or None
        The controller that was tuned instead of the controller of the file; None for the controller of the file.
    relative_costs : ndarray (p, k)
        Cost relative to the least cost [no unit], if one gain at a time is multiplied by each of k factors.
    speed_m_s : float
        Mean speed of the routes.
    worst_case : WorstCase or None
        Largest cost over drawn vehicles; None: only the vehicle of the file was used.
    fresh_seeds : FreshSeeds or None
        Cost with other noise; None: the search was without noise.

    Examples
    --------
    >>> result = bq.tune(bq.load("small"), bq.guides.shapes.circle(0.3, 0.2), gains=["k_chi"], starts=1, polish=False,
    ...                 duration_s=2.0)
    >>> list(result.values), result.loop
    (['k_chi'], 'perfect pose')
    """

    vehicle_file: "VehicleFile" = field(repr=False)
    gains: tuple[Gain, ...]
    cost: float
    cost_before: float
    cost_uncontrolled: float
    weights: "Weights"
    drive: DriveErrors
    descents: tuple["Descent", ...]
    history: np.ndarray
    loop: str
    backend: str
    controller: Controller
    kind: OwnBlock | None
    relative_costs: np.ndarray
    speed_m_s: float
    worst_case: WorstCase | None = None
    fresh_seeds: FreshSeeds | None = None

    @property
    def values(self) -> dict[str, float]:
        """Return the gains by name."""
        return {gain.name: gain.value for gain in self.gains}

    @property
    def margins(self) -> tuple[LoopMargins, ...]:
        """Return the gain, phase and delay margins of each channel of the loop at the speed of the routes."""
        return loop_margins(self.vehicle_file, self.controller, self.speed_m_s)

    @property
    def agreeing_descents(self) -> int:
        """Return the number of descents whose cost is at most (1 + AGREEMENT_TOLERANCE) times the least cost."""
        return sum(d.cost <= self.cost * (1.0 + AGREEMENT_TOLERANCE) for d in self.descents)

    @property
    def verdict(self) -> Verdict:
        """Return USABLE without reasons, WARN with warnings, REFUSED with an error."""
        return Verdict.of(self.reasons)

    @property
    def reasons(self) -> tuple[Diagnostic, ...]:
        """Return the reasons not to use these gains: one error, or all warnings."""
        if not self.cost < 0.5 * self.cost_uncontrolled:
            distance_rms_m = self.drive.distance_rms_m
            return (note("tune.uncontrolled", Severity.ERROR, distance_m=distance_rms_m),)
        margins = self.margins
        jerk_m2 = SMOOTHER * self.weights.jerk_m2 or SMOOTHER * SMALL_JERK_M2
        smoother = f"--jerk {jerk_m2:g}"
        if not all(m.stable for m in margins):
            return (note("tune.unstable", Severity.ERROR, smoother, speed_m_s=margins[0].speed_m_s),)
        messages = []
        for gain in (g for g in self.gains if g.bound_side and g.high > g.low):
            code, end = (
                ("tune.at-lower-limit", gain.low)
                if gain.bound_side < 0
                else ("tune.at-upper-limit", gain.high)
            )
            messages.append(note(code, Severity.WARNING, subject=gain.name, limit=end, unit=gain.unit))
        if len(self.descents) > 1 and self.agreeing_descents == 1:
            messages.append(note("tune.one-start", Severity.WARNING, starts=len(self.descents)))
        narrow = next(filter(_is_narrow, sorted(margins, key=lambda m: m.gain_up)), None)
        if narrow is not None:
            figures: JsonObject = {
                "gain": narrow.gain_up,
                "phase_deg": np.degrees(abs(narrow.phase_rad)),
                "delay_ms": 1e3 * narrow.delay_s,
                "jerk_m2": jerk_m2,
            }
            messages.append(note("tune.narrow-margin", Severity.WARNING, smoother, narrow.channel, **figures))
        if self.drive.saturated_fraction > 0.2:
            messages.append(
                note("tune.saturated", Severity.WARNING, percent=100 * self.drive.saturated_fraction)
            )
        return tuple(messages)

    def rows(self) -> list["TableRow"]:
        """Return one flat row per gain."""
        drive = self.drive._asdict()
        shared_columns = {
            "cost": self.cost,
            "cost_before": self.cost_before,
            "cost_uncontrolled": self.cost_uncontrolled,
        }
        shared_columns |= {**drive, "starts": len(self.descents), "agreeing_starts": self.agreeing_descents}
        shared_columns["evaluations"] = len(self.history)
        shared_columns |= {
            f"worst_{name}": x for name, x in (self.worst_case._asdict() if self.worst_case else {}).items()
        }
        shared_columns |= {
            f"fresh_{name}": x for name, x in (self.fresh_seeds._asdict() if self.fresh_seeds else {}).items()
        }
        for m in self.margins:
            margins = {k: x if np.isfinite(x) else None for k, x in m._asdict().items() if k != "channel"}
            shared_columns |= {f"{m.channel}_{name}": x for name, x in margins.items()}
        table_rows = []
        for g in self.gains:
            row: TableRow = {"name": g.name, "value": g.value, "unit": g.unit, "file_value": g.file_value}
            row |= {"low": g.low, "high": g.high, "bound": {-1: "low", 1: "high"}.get(g.bound_side)}
            table_rows.append(
                row
                | {"cost_at_0.8": g.cost_at_lower_gain, "cost_at_1.25": g.cost_at_higher_gain}
                | shared_columns
            )
        return table_rows

    def table(self) -> str:
        """Return a text with gains, costs, checks and verdict."""
        head = [_("gain"), _("value"), _("unit"), _("in the file"), _("cost at × 0.8"), _("at × 1.25")]
        rows = (
            [g.name, f"{number(g.value):.4g}", shown_unit(g.unit),
             f"{number(g.file_value):.4g}" if np.isfinite(g.file_value) else "-",
             *(f"{number(100 * (cost - 1)):+.1f} %" for cost in (g.cost_at_lower_gain, g.cost_at_higher_gain))]
            for g in self.gains
        )  # fmt: skip
        lines = text_table("<><>>>", head, *rows)
        return "\n".join([*lines, "", *self._notes(), "", verdict_line(self.verdict, self.reasons)])

    def _notes(self) -> list[str]:
        d, w = self.drive, self.weights
        previous_cost = f"{number(self.cost_before):.4g} → " if np.isfinite(self.cost_before) else ""
        worst_case_text = (
            _(", as for the worst of {vehicles} vehicles", vehicles=self.worst_case.draws)
            if self.worst_case
            else ""
        )
        return [
            _(
                "cost {file_cost_text}{cost:.4g} m²{over}, {standing:.4g} m² without control; tuned with: {loop}; "
                "a heading error of 1 rad counts as {radian_m:.3g} m",
                file_cost_text=previous_cost, cost=self.cost, over=worst_case_text, standing=self.cost_uncontrolled,
                radian_m=w.radian_m,
                loop=_(self.loop),
            ),
            _(
                "error from the reference after a start {start_mm:.0f} mm from it: {rms_mm:.1f} mm rms, "
                "{max_mm:.1f} mm at most, heading {heading_deg:.2f}° rms",
                start_mm=1000 * d.start_m, rms_mm=1000 * d.distance_rms_m, max_mm=1000 * d.distance_max_m,
                heading_deg=np.degrees(d.heading_rms_rad),
            ),
            _(
                "command at its limit {percent:.0f} % of the time; {agreed} of {starts} searches end at the same "
                "cost, after {evaluations} evaluations in total",
                percent=100 * d.saturated_fraction, agreed=self.agreeing_descents, starts=len(self.descents),
                evaluations=len(self.history),
            ),
            *self._check_lines(),
            *map(_margins_line, self.margins),
        ]  # fmt: skip

    def _check_lines(self) -> list[str]:
        """Return the lines with the cost on vehicles and noise that the search did not use."""
        lines = []
        if self.worst_case:
            lines.append(
                _(
                    "worst of {test_vehicles} other vehicles: {cost:.4g} m², {nominal:.4g} m² with gains for the "
                    "vehicle of the file",
                    test_vehicles=self.worst_case.test_vehicles,
                    cost=self.worst_case.cost,
                    nominal=self.worst_case.nominal,
                )
            )
        if self.fresh_seeds:
            lines.append(
                _(
                    "on {seeds} other seeds {cost:.4g} m², on the seeds of the search {search_cost:.4g} m²",
                    **self.fresh_seeds._asdict(),
                )
            )
        return lines  # fmt: skip

    @checked_call("gains.updated_file()")
    def updated_file(self) -> "VehicleFile":
        """Return a vehicle file with these gains; nothing is written to disk."""
        from baqueano.vehicle_file.provenance import Provenance

        values = file_values(self.controller, self.values, self.kind)
        origin = Provenance(run=f"tune, {self.loop}", verdict=self.verdict)
        keys = [key for key in values if key != "controller.kind"]
        return self.vehicle_file.with_values(values, dict.fromkeys(keys, origin))

    @checked_call('gains.save("vehicle.toml")')
    def save(self, path: str | Path | None = None) -> Path:
        """Write the vehicle file with these gains, to `path` or by default to its present path; return the path."""
        return self.updated_file().save(path)


def _is_narrow(m: LoopMargins) -> bool:
    """Return True if a small error of the model makes this loop oscillate."""
    return (
        m.gain_up < MIN_GAIN_MARGIN
        or m.delay_s < MIN_DELAY_MARGIN_S
        or abs(m.phase_rad) < MIN_PHASE_MARGIN_RAD
    )


def _margins_line(m: LoopMargins) -> str:
    """Return one line of text with the margins of a channel."""
    if not m.stable:
        return _("{channel} at {speed_m_s:.2g} m/s: unstable", channel=m.channel, speed_m_s=m.speed_m_s)
    if not np.isfinite(m.phase_rad) and not np.isfinite(m.gain_up):
        return _("{channel}: no gain and no delay makes this loop unstable", channel=m.channel)
    return _(
        "{channel} at {speed_m_s:.2g} m/s: becomes unstable with {gain_up:.2f} times the gain, {phase_deg:.0f}° more "
        "phase lag, or {delay_ms:.0f} ms more delay",
        channel=m.channel, speed_m_s=m.speed_m_s, gain_up=m.gain_up, phase_deg=np.degrees(m.phase_rad),
        delay_ms=1000 * m.delay_s,
    )  # fmt: skip
