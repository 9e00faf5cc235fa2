"""Predict the corridor of a route before it is driven.

The vehicle of the file drives the route in simulation, with its noise, its controller and its estimator. The covariance
of the estimator along that drive is the forecast: it includes the noise, the biases and the scales of the file. A
vehicle that differs from the file drives farther from its path; the forecast does not include this effect.
"""

from dataclasses import dataclass

import numpy as np

from baqueano.compare.corridor import Corridor, run_corridor
from baqueano.contracts.calls import checked_call
from baqueano.contracts.result import Result
from baqueano.contracts.values import TableRow
from baqueano.errors import AnswerNo
from baqueano.guides.route import Route
from baqueano.messages.language import mark as N_, translate as _
from baqueano.runs.run import Run
from baqueano.simulate import simulate_loop
from baqueano.standstill import usual_rest_s
from baqueano.vehicle_file import VehicleFile


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CorridorForecast(Result):
    """The predicted corridor at the end of each lap, or of an open route.

    Attributes
    ----------
    corridor : Corridor
        Half-widths with 95 % probability at each tick.
    laps : int
        Number of laps.
    lap_s : float
        Duration of a lap.
    run : Run
        The simulated drive.
    """

    corridor: Corridor
    laps: int
    lap_s: float
    run: Run

    @property
    def verdict(self) -> str:
        """Return LOST if the vehicle is lost before the end (σ_ψ too large), else LOCALIZED."""
        return "LOST" if np.isfinite(self.corridor.loss_s) else "LOCALIZED"

    def rows(self) -> list[TableRow]:
        """Return one flat row per lap (SI); NaN if the vehicle is lost before the end of the lap."""
        rows = []
        for lap in range(1, self.laps + 1):
            row, k = {"lap": lap, "t_s": lap * self.lap_s}, self._tick(lap)
            for name in ("across_m", "heading_rad", "area_m2"):
                row[name] = np.nan if k is None else float(getattr(self.corridor, name)[k])
            rows.append(row)
        return rows

    def table(self) -> str:
        """Return the corridor at the end of each lap, and the verdict, as text."""
        lines = []
        for lap in range(1, self.laps + 1):
            k = self._tick(lap)
            if k is not None:
                figures = {"lap": lap, "t_s": lap * self.lap_s, "region": self.corridor.region_text(k)}
                lines.append(_("lap {lap}, {t_s:.0f} s: {region} (95 %)", **figures))
        return "\n".join([*lines, f"{_(self.verdict)}: {self.corridor.sentence}"])

    def _tick(self, lap: int) -> int | None:
        """Return the index of the tick at which a lap ends; None if the vehicle is lost before this tick."""
        if self.corridor.loss_s <= lap * self.lap_s:
            return None
        return min(int(np.searchsorted(self.corridor.t_s, lap * self.lap_s)), len(self.corridor.t_s) - 1)


@checked_call("bq.forecast(robot, route)")
def forecast_corridor(
    vehicle_file: VehicleFile, route: Route, laps: int = 1, backend: str = "auto", rest_s: float | None = None
) -> CorridorForecast:
    """Predict the 95 % corridor of a vehicle on a route, before it drives there.

    Parameters
    ----------
    vehicle_file : VehicleFile
        The vehicle with its estimator and controller.
    route : Route
        The path and its times.
    laps : int
        Laps of a closed route.
    backend : str
        "auto", "c", "python" or "numpy".
    rest_s : float, optional [s]
        Time for which the vehicle is at rest before the drive, as in `repeat`.

    Returns
    -------
    CorridorForecast
        A row per lap.

    Raises
    ------
    AnswerNo
        If the estimator of the file does not report a covariance of the pose.

    Examples
    --------
    >>> from baqueano.guides.shapes import circle
    >>> from baqueano.vehicle_file import load
    >>> ahead = forecast_corridor(load("small"), circle(0.3, 0.2), 2)
    >>> [row["lap"] for row in ahead.rows()], ahead.rows()[0]["heading_rad"] < ahead.rows()[1]["heading_rad"]
    ([1, 2], True)
    """
    laps = laps if route.closed else 1
    rest_s = usual_rest_s(vehicle_file.sensors) if rest_s is None else rest_s
    options = {"laps": laps, "noise": True, "rest_s": rest_s, "backend": backend}
    run = simulate_loop(vehicle_file, route, name="forecast", **options).without_rest
    corridor = run_corridor(run)
    if corridor is None:
        kind = vehicle_file.data["estimator"].get("kind", N_("of this vehicle"))
        raise AnswerNo.of("forecast.no-covariance", "--set estimator.kind=augmented_ekf", estimator=kind)
    return CorridorForecast(corridor, laps, run.duration_s / laps, run)
