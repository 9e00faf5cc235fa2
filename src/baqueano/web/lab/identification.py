"""Identify the parameters of a vehicle during a drive, in a worker process, from the rows that the page receives.

The information of each window is exact (design/live.py). A complete fit over all rows runs in a thread,
first after FIRST_FIT_S of driving, then each second or less often: it uses at most MAX_FIT_SHARE of the time. The
expected errors follow from the information: at the values of the vehicle file before the first fit, at the fitted
values afterwards. The fit determines the values, their standard errors and the verdict.
"""

import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from baqueano.contracts.values import JsonObject
from baqueano.design.information import DriveInformation
from baqueano.design.live import WINDOW_TICKS, MotionAdvisor, RecursiveInformation, information_bits
from baqueano.diagnostics import Diagnostic, Verdict, note
from baqueano.errors import BaqueanoError
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.fit import identify
from baqueano.identify.parameters.free import FreeParameter, free_parameter
from baqueano.identify.result.fit_result import Fit
from baqueano.runs.logs import Channel
from baqueano.runs.run import Run
from baqueano.signals import NANOSECONDS
from baqueano.vehicle_file.file import VehicleFile

FIRST_FIT_S = 8.0  # drive time before the first fit
PERIOD_S, SLOW_PERIOD_S = 1.0, 15.0  # between fits, with a compiler and without one
MAX_FIT_SHARE = 0.5  # largest share of the time for fits
BUDGET_S = 0.3  # time for windows in one question; further windows wait
PREVIOUS_BARS_S = 2.5  # drive time between the pale bars and now
MAX_CURVE_POINTS = 300  # points of the information curve
FIT_COUNT = 6  # number of fits of a finished run
MAX_RELATIVE_STD = 0.3  # relative standard error above which a motion is missing
# fraction of the magnitude in the file; the error of a smaller value is relative to that magnitude
MIN_SIZE_SHARE = 0.05
MAX_GAP_S = 5.0


class DriveFit(NamedTuple):
    """A fit of the first `t_s` seconds of a drive, and its computing time `computing_s`."""

    fit: Fit
    t_s: float
    computing_s: float


class DriveIdentification:
    """The identification of one drive of a vehicle at a time. The same thread must call `add_rows` and `state`."""

    def __init__(self, vehicle_file: VehicleFile, backend: str = "auto") -> None:
        self.vehicle_file = vehicle_file
        self._drive_information = DriveInformation(vehicle_file, backend)
        self._live = RecursiveInformation(self._drive_information)
        self._advisor = MotionAdvisor(
            self._drive_information, np.asarray(vehicle_file.command.limit, dtype=float), vehicle_file.rate_hz
        )
        blocks = FittedBlocks(vehicle_file.vehicle, vehicle_file.sensors)
        self._free = [free_parameter(blocks, path, {}) for path in self._drive_information.unknowns.names]
        self._sizes = {
            name: int(getattr(vehicle_file.sensors, name).size) for name in vehicle_file.sensors._fields
        }
        self.compiled = self._drive_information.kernel.backend == "c"
        self._thread = ThreadPoolExecutor(1)
        self.restart()

    def restart(self) -> None:
        """Reset the identification for another drive of the same vehicle."""
        self._job: Future[DriveFit | Diagnostic] | None = None
        self._next_s = 0.0
        self._reason: Diagnostic | None = None  # why the last fit failed
        self._last_fit: DriveFit | None = None
        self._fit_ticks = 0  # number of ticks of the last fit
        self._theta, self._size = self._drive_information.nominal, self._drive_information.unknowns.size
        self._error_ratios = np.ones(
            len(self._free)
        )  # errors of the last fit, relative to the expected errors
        self._reset()

    def _reset(self) -> None:
        n, m = len(self.vehicle_file.command.names), sum(self._sizes.values())
        self._ticks = np.zeros(0, dtype=np.int64)
        self._u, self._z = np.zeros((0, n)), np.zeros((0, m))
        self._information = self._live.begin(self._theta)
        self._std: list[np.ndarray] = []  # (p,) after each window
        self._fit_ticks = 0

    def compile_kernels(self) -> None:
        """Compile the code for a window before the first window arrives."""
        if self.compiled:
            rest_command = np.zeros((WINDOW_TICKS, self._u.shape[1]))
            self._live.add(self._information, rest_command)
            self._drive_information.information(rest_command)

    @property
    def duration_s(self) -> float:
        """Return the duration [s] of the drive so far."""
        return len(self._ticks) / self.vehicle_file.rate_hz

    @property
    def is_busy(self) -> bool:
        """Return True while a fit runs, or while rows wait for their window or fit."""
        is_due = self.duration_s >= FIRST_FIT_S and self._fit_ticks < len(self._ticks)
        return self._job is not None or is_due or len(self._std) < len(self._ticks) // WINDOW_TICKS

    def add_rows(self, names: list[str], rows: list[list[float | None]]) -> None:
        """Add the ticks that follow the ticks added before.

        A missing tick is filled with the last command, without measurements. An older tick is ignored. After a gap
        over MAX_GAP_S the drive begins again.
        """
        x = np.array(rows, dtype=float).reshape(len(rows), len(names))
        columns = {name: k for k, name in enumerate(names)}
        n, unknown = self._u.shape[1], np.full(len(x), np.nan)
        ticks = np.rint(x[:, columns["t"]] * self.vehicle_file.rate_hz).astype(np.int64)
        u = np.column_stack([x[:, columns[f"u.{k}"]] for k in range(n)])
        channels = [f"z.{name}[{k}]" for name, size in self._sizes.items() for k in range(size)]
        z = np.column_stack(
            [x[:, columns[channel]] if channel in columns else unknown for channel in channels]
        )
        last_tick = self._ticks[-1] if len(self._ticks) else ticks[0] - 1
        is_new = ticks > np.maximum.accumulate(np.concatenate([[last_tick], ticks]))[:-1]
        is_new &= np.isfinite(u).all(axis=1)
        ticks, u, z = ticks[is_new], u[is_new], z[is_new]
        if not len(ticks):
            return
        if np.max(np.diff(ticks, prepend=last_tick)) > MAX_GAP_S * self.vehicle_file.rate_hz:
            self._reset()
            last_tick = ticks[0] - 1
        all_ticks = np.arange(last_tick + 1, ticks[-1] + 1)
        indices = np.searchsorted(ticks, all_ticks, side="right") - 1
        in_force = np.concatenate([self._u[-1:] if len(self._u) else u[:1], u])[indices + 1]
        z_on_ticks = np.where(
            (indices >= 0)[:, None] & (ticks[indices] == all_ticks)[:, None], z[indices], np.nan
        )
        self._ticks = np.concatenate([self._ticks, all_ticks])
        self._u, self._z = np.concatenate([self._u, in_force]), np.concatenate([self._z, z_on_ticks])

    def state(self) -> JsonObject:
        """Return what the page shows about the identification, and start a fit if one is due."""
        self._use_finished_fit()
        self._advance(time.monotonic() + BUDGET_S)
        now_s = time.monotonic()
        is_due = self.duration_s >= FIRST_FIT_S and self._fit_ticks < len(self._ticks)
        if self._job is None and is_due and now_s >= self._next_s:
            self._fit_ticks = len(self._ticks)
            self._next_s = now_s + (PERIOD_S if self.compiled else SLOW_PERIOD_S)
            self._job = self._thread.submit(self._fit, self.run())
        return self._description()

    def run_state(self, run: Run) -> JsonObject:
        """Return the state for a finished run, with fits of growing parts of it; all its rows must have been added."""
        end_times_s = np.geomspace(
            FIRST_FIT_S, max(FIRST_FIT_S, run.duration_s), FIT_COUNT if self.compiled else 1
        )
        fits: list[DriveFit] = []
        for t_s in [*end_times_s[:-1].tolist(), run.duration_s]:
            result = self._fit(run.cut(0.0, t_s) if t_s < run.duration_s else run)
            if isinstance(result, Diagnostic):
                self._reason = result
            else:
                fits.append(result)
                self._reason = None
        if fits:
            self._use_fit(fits[-1])
        self._advance(float("inf"))
        step = max(1, len(self._std) // MAX_CURVE_POINTS)
        return self._description() | {
            "fits": [self._fit_json(fit) for fit in fits], "step_s": step * self._window_s,
            "expected": [_rounded_list(std) for std in self._std[step - 1 :: step]],
        }  # fmt: skip

    def run(self) -> Run:
        """Return the rows added so far as a run."""
        t_ns = (self._ticks * round(NANOSECONDS / self.vehicle_file.rate_hz)).astype(np.int64)
        sensors, offset = {}, 0
        for name, size in self._sizes.items():
            z, offset = self._z[:, offset : offset + size], offset + size
            is_valid = np.isfinite(z).all(axis=1)
            if is_valid.any():
                sensors[name] = Channel(t_ns[is_valid], t_ns[is_valid], z[is_valid])
        return Run("live", None, t_ns, self._u, sensors=sensors, vehicle_text=self.vehicle_file.text)

    def close(self) -> None:
        """End the thread and cancel the fits that have not begun."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    @property
    def _window_s(self) -> float:
        return WINDOW_TICKS / self.vehicle_file.rate_hz

    def _fit(self, run: Run) -> DriveFit | Diagnostic:
        """Return a fit of a run, or the diagnostic of its failure."""
        began_s = time.monotonic()
        try:
            fit = identify(run, self.vehicle_file)
        except BaqueanoError as error:
            return error.diagnostic
        return DriveFit(fit, len(run.t_ns) / self.vehicle_file.rate_hz, time.monotonic() - began_s)

    def _use_finished_fit(self) -> None:
        """Use a fit that has finished for the expected errors, and plan the time of the next fit."""
        if self._job is None or not self._job.done():
            return
        result, self._job = self._job.result(), None
        if isinstance(result, Diagnostic):
            self._reason = result
            return
        self._reason, began_s = None, time.monotonic()
        self._use_fit(result)
        elapsed_s = result.computing_s + time.monotonic() - began_s
        self._next_s = max(self._next_s, time.monotonic() + elapsed_s * (1.0 / MAX_FIT_SHARE - 1.0))

    def _use_fit(self, drive_fit: DriveFit) -> None:
        """Compute the expected errors at the values of this fit; a refused fit does not change them."""
        self._last_fit = drive_fit
        if drive_fit.fit.verdict == Verdict.REFUSED:
            return
        identifiable = np.isfinite(drive_fit.fit.estimate)
        names = [name for name, is_known in zip(drive_fit.fit.names, identifiable, strict=True) if is_known]
        self._theta = self._drive_information.theta(names, drive_fit.fit.estimate[identifiable])
        parameter_sizes = self._drive_information.unknowns.size
        own_indices = np.concatenate(
            [
                np.abs(self._theta[: self._drive_information.unknowns.interest_count]),
                parameter_sizes[self._drive_information.unknowns.interest_count :],
            ]
        )
        self._size = np.where(own_indices > MIN_SIZE_SHARE * parameter_sizes, own_indices, parameter_sizes)
        self._information, self._std = self._live.begin(self._theta), []
        self._advance(float("inf"))
        window_index = min(len(self._std), round(drive_fit.t_s / self._window_s)) - 1
        if window_index >= 0:
            errors = [np.nan if std is None else std for std in self._fit_json(drive_fit)["std"]]
            self._error_ratios = np.fmax(np.array(errors, dtype=float) / self._std[window_index], 1.0)

    def _advance(self, end_s: float) -> None:
        """Add the information of the complete windows that have arrived, at most until the time `end_s`."""
        is_valid = np.isfinite(self._z).astype(float)
        for start in range(len(self._std) * WINDOW_TICKS, len(self._ticks) - WINDOW_TICKS + 1, WINDOW_TICKS):
            rows = slice(start, start + WINDOW_TICKS)
            self._information = self._live.add(self._information, self._u[rows], is_valid[rows])
            self._std.append(self._live.relative_std(self._information, self._size))
            if time.monotonic() > end_s:
                return

    def _description(self) -> JsonObject:
        std = np.array(self._std) if self._std else np.ones((1, len(self._free)))
        ago = max(0, len(std) - 1 - round(PREVIOUS_BARS_S / self._window_s))
        windows_per_point = max(1, -(-len(std) // MAX_CURVE_POINTS))  # windows per point of the curve
        total = -np.sum(np.log2(std[windows_per_point - 1 :: windows_per_point]), axis=1)
        rate = np.maximum(np.diff(total, prepend=0.0), 0.0) / (windows_per_point * self._window_s)
        value = (
            [None] * len(self._free) if self._last_fit is None else self._fit_json(self._last_fit)["value"]
        )
        return {
            "t": self.duration_s, "start": self._start_s, "dt": windows_per_point * self._window_s,
            "rate": rate.round(2).tolist(),
            "bits": information_bits(std[-1]) + 0.0, "std": _rounded_list(std[-1]),
            "former_std": _rounded_list(std[ago]), "compiled": self.compiled,
            "parameters": [self._parameter_json(free, std[-1, k], value[k]) for k, free in enumerate(self._free)],
            "fit": None if self._last_fit is None else self._fit_json(self._last_fit), "next": self._advised_motion(),
            "reason": None if self._reason is None else self._reason.to_json(),
            "busy": self.is_busy, "first": FIRST_FIT_S,
        }  # fmt: skip

    @property
    def _start_s(self) -> float:
        return float(self._ticks[0]) / self.vehicle_file.rate_hz if len(self._ticks) else 0.0

    def _parameter_json(self, free: FreeParameter, std: float, value: float | None) -> JsonObject:
        is_missing = free.shown_by and (
            std > MAX_RELATIVE_STD or (self._last_fit is not None and value is None)
        )
        return {
            "path": free.short_name, "label": parameter_label(free).to_json(),
            "unit": "" if free.unit == "1" else free.unit.replace(" per unit of u", "/u").replace("unit of u", "u"),
            "guess": float(self._drive_information.nominal[self._drive_information.unknowns.names.index(free.path)]),
            "needs": note("parameter.needs", motion=free.shown_by).to_json() if is_missing else None,
        }  # fmt: skip

    def _fit_json(self, drive_fit: DriveFit) -> JsonObject:
        """Return a fit as data for JSON: values, relative standard errors up to 10 (None: unknown), and verdict."""
        fit, value, std = drive_fit.fit, [], []
        for path in self._drive_information.unknowns.names:
            k = fit.names.index(path) if path in fit.names else None
            x = float("nan") if k is None else float(fit.estimate[k])
            identifiable = np.isfinite(x) and k is not None
            value.append(x if identifiable else None)
            relative_std = float(fit.std[k]) / abs(x) if identifiable and x != 0.0 else float("inf")
            std.append(min(relative_std, 10.0) if np.isfinite(relative_std) else None)
        reason_json = fit.reasons[0].to_json() if fit.reasons and fit.verdict != Verdict.USABLE else None
        return {
            "t": drive_fit.t_s, "took_s": drive_fit.computing_s, "value": value, "std": std,
            "verdict": str(fit.verdict), "verdict_id": str(fit.verdict), "reason": reason_json,
        }  # fmt: skip

    def _advised_motion(self) -> JsonObject | None:
        """Return the advised motion, which would reduce the uncertainty most.

        Return None before the first window, or if no motion is advised. Also return None without a compiler, because
        the search would take seconds.
        """
        if not self.compiled or not self._std:
            return None
        advice = self._advisor.next_motion(self._information.F, self._theta, self._size, self._error_ratios)
        if advice is None:
            return None
        label = parameter_label(self._free[advice.parameter]).to_json()
        return {
            "motion": advice.words.to_json(),
            "label": label,
            "from": advice.error_before,
            "to": advice.error_after,
        }


def parameter_label(parameter: FreeParameter) -> Diagnostic:
    """Return the name of a parameter as a diagnostic to show to people."""
    if parameter.label:
        return note("parameter.label", meaning=parameter.label, entry="")
    entry = f" [{', '.join(map(str, parameter.entry))}]" if parameter.entry else ""
    return note("parameter.label", meaning=parameter.definition.meaning, entry=entry)


def _rounded_list(std: np.ndarray) -> list[float]:
    return [float(f"{x:.4g}") for x in std]
