"""Test the consistency of a filter: NEES per state and joint, NIS per channel and joint, and one sentence.

If the truth is known, the sentence reports the joint NEES of pose and velocity. If no sensor bounds the pose, its NEES
has too few samples, and the sentence reports this. If a NEES cannot decide, the NIS can still show "too sure" or "too
cautious". The false alarm rate FALSE_ALARM is for all tests together: each test has a share of this rate.

    lag-1 autocorrelation of an innovation   Σ y_t y_{t−1} / Σ y_t²;  for white noise 95 % are within ± 1.96/√N   (1)
"""

from dataclasses import dataclass

import numpy as np

from baqueano.compare import consistency
from baqueano.compare.consistency import FALSE_ALARM, NOT_REPORTED, Band
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, note
from baqueano.geometry import wrap
from baqueano.messages import text
from baqueano.messages.language import mark as N_, translate as _
from baqueano.monitor.rejections import rejections_in
from baqueano.runs.interpolation import interpolate_poses, interpolate_rows
from baqueano.runs.run import Run

STATE_NAMES = {
    "x": "x",
    "y": "y",
    "heading": N_("heading"),
    "v_x": "v_x",
    "v_y": "v_y",
    "yaw_rate": N_("yaw rate"),
}
JOINT_FIGURES = {
    "nees_pose": N_("the pose"),
    "nees_velocity": N_("the velocity"),
    "nis": N_("the innovations"),
}


@dataclass(frozen=True, slots=True, eq=False)
class FilterConsistency:
    """The consistency bands of one run."""

    nees_pose: Band
    nees_velocity: Band
    nis: Band
    states: dict[str, Band]  # NEES by name of STATE_NAMES
    channels: dict[str, Band]  # NIS by channel of the innovation, such as "imu[2]"
    correlations: tuple[float, ...]  # lag-1 autocorrelation of each innovation  (1)
    correlation_limit: float

    @property
    def verdict(self) -> str:
        """Return "too sure", "too cautious", "consistent", "cannot tell" or "not reported"."""
        return self._decision()[0]

    @property
    def sentence(self) -> str:
        """Return the messages as sentences in the current language."""
        return " ".join(f"{text(message)}." for message in self.messages)

    @property
    def messages(self) -> tuple[Diagnostic, ...]:
        """Return the verdict with its value and its worst state, then its limitations: few samples, autocorrelation."""
        verdict, name, band = self._decision()
        if band is None:
            return (note("consistency.not-reported"),)
        if verdict == "cannot tell":
            return (note("consistency.cannot-tell", quantity=JOINT_FIGURES[name], samples=band.samples),)
        figures = {"mean": band.mean, "low": band.low, "high": band.high, "worst": self._worst_band(verdict)}
        figure = "NIS" if name == "nis" else "NEES"
        first = note(
            f"consistency.{verdict.replace(' ', '-')}", figure=figure, quantity=JOINT_FIGURES[name], **figures
        )
        messages = (first, self._sample_warning(verdict), self._correlation())
        return tuple(message for message in messages if message is not None)

    @property
    def correlation(self) -> float:
        """Return the lag-1 autocorrelation of largest magnitude; NaN without innovations."""
        finite_correlations = [correlation for correlation in self.correlations if np.isfinite(correlation)]
        return max(finite_correlations, key=abs) if finite_correlations else float("nan")

    def row(self) -> JsonObject:
        """Return a flat row for programs."""
        row: TableRow = {}
        for name, band in self._named_bands().items():
            row |= {name: band.mean, f"{name}_low": band.low, f"{name}_high": band.high}
            row |= {f"{name}_verdict": band.verdict}
        row |= {
            "innovation_correlation": self.correlation,
            "innovation_correlation_limit": self.correlation_limit,
        }
        return row | {
            f"innovation_correlation[{k}]": correlation for k, correlation in enumerate(self.correlations)
        }

    def figures(self) -> list[TableRow]:
        """Return a row for each known NEES and NIS, for a table."""
        return [
            {"figure": name, "value": band.mean, "from": band.low, "to": band.high,
             "independent samples": band.samples, "verdict": band.verdict}
            for name, band in self._named_bands().items() if np.isfinite(band.mean)
        ]  # fmt: skip

    def _named_bands(self) -> dict[str, Band]:
        bands = {name: getattr(self, name) for name in JOINT_FIGURES}
        bands |= {f"nees_{name}": band for name, band in self.states.items()}
        return bands | {f"nis[{k}]": band for k, band in enumerate(self.channels.values())}

    def _decision(self) -> tuple[str, str, Band | None]:
        """Return the verdict, the name of the joint test that decides, and its band (None if not reported)."""
        truth = [(name, getattr(self, name)) for name in ("nees_pose", "nees_velocity")]
        bands = [(name, band) for name, band in truth if band.verdict != "not reported"]
        deciding_bands = [*bands, ("nis", self.nis)]
        if not bands or any(band.verdict != "consistent" for _, band in bands):
            for verdict in ("too sure", "too cautious"):
                for name, band in deciding_bands:
                    if band.verdict == verdict:
                        return verdict, name, band
        bands = bands or [("nis", self.nis)]
        if bands[0][1].verdict == "not reported":
            return "not reported", "", None
        consistent_bands = [pair for pair in bands if pair[1].verdict == "consistent"]
        name, band = max(consistent_bands or bands, key=lambda pair: pair[1].samples)
        return "consistent" if consistent_bands else "cannot tell", name, band

    def _worst_band(self, verdict: str) -> Diagnostic | str:
        """Return the state that deviates most in the direction of the verdict; "" if no state deviates."""
        deviating_means = {
            name: band.mean for name, band in self.states.items() if band.verdict == verdict != "consistent"
        }
        if not deviating_means:
            return ""
        name = max(deviating_means, key=lambda name: abs(np.log(deviating_means[name])))
        return note("consistency.worst", state=STATE_NAMES[name], nees=deviating_means[name])

    def _sample_warning(self, verdict: str) -> Diagnostic | None:
        """Return a note if the verdict is "consistent" but a joint NEES has too few samples, else None."""
        short_names = [n for n in ("nees_pose", "nees_velocity") if getattr(self, n).verdict == "cannot tell"]
        if short_names and verdict == "consistent":
            return note("consistency.unknown", quantity=JOINT_FIGURES[short_names[0]])
        return None

    def _correlation(self) -> Diagnostic | None:
        if not abs(self.correlation) > max(self.correlation_limit, 0.1):
            return None
        return note("consistency.correlated", correlation=self.correlation)


def filter_consistency(run: Run, alignment: str = "none") -> FilterConsistency:
    """Return the filter consistency of a run. The NEES of the pose is known only for the alignment "none"."""
    log, truth = run.estimate, run.truth
    errors: dict[str, np.ndarray] = {}  # whitened
    states: dict[str, Band] = dict.fromkeys(STATE_NAMES, NOT_REPORTED)
    channels: dict[str, Band] = {}
    correlations, limit = np.zeros(0), float("nan")
    if log is not None and truth is not None and len(truth.t_ns) > 1:
        e = np.column_stack([
            log.eta - interpolate_poses(log.t_ns, truth.t_ns, truth.eta),
            log.nu - interpolate_rows(log.t_ns, truth.t_ns, truth.nu),
        ])  # fmt: skip
        e[:, 2] = wrap(e[:, 2])
        e[:, :3] = e[:, :3] if alignment == "none" else np.nan
        errors["nees_pose"] = consistency.whiten(e[:, :3], log.cov[:, :3, :3])
        errors["nees_velocity"] = consistency.whiten(e[:, 3:], log.cov[:, 3:, 3:])
        for k, name in enumerate(STATE_NAMES):
            error = consistency.whiten(e[:, [k]], log.cov[:, [[k]], [k]])
            states[name] = (
                consistency.band(error) if np.nanmax(np.abs(error), initial=0.0) > 0.0 else NOT_REPORTED
            )
    if log is not None and log.innovation is not None and log.innovation_cov is not None:
        y, S = log.innovation, log.innovation_cov
        deviations = np.sqrt(np.diagonal(S, axis1=1, axis2=2))
        ratios = (y / deviations).T
        names = innovation_names(run, len(ratios))
        accepted_rows = _correction_indices(run, len(ratios))
        errors["nis"] = consistency.whiten(y[:, accepted_rows], S[:, accepted_rows][:, :, accepted_rows])
        channels = {name: consistency.band(ratio[:, None]) for name, ratio in zip(names, ratios, strict=True)}
        correlations = consistency.whiteness(y, S)
        samples = np.max(np.sum(np.isfinite(y), axis=0), initial=0)
        limit = float(1.96 / np.sqrt(samples)) if samples else limit
    names = [name for name, w in errors.items() if np.isfinite(w).any()]
    bands = dict.fromkeys(JOINT_FIGURES, NOT_REPORTED)
    bands |= {name: consistency.band(errors[name], FALSE_ALARM / len(names)) for name in names}
    return FilterConsistency(
        **bands, states=states, channels=channels, correlations=tuple(correlations.tolist()),
        correlation_limit=limit,
    )  # fmt: skip


def innovation_names(run: Run, size: int) -> list[str]:
    """Return the names of the `size` entries of an innovation: channels such as "imu[2]" if the run contains them."""
    names = [refusal.name for refusal in rejections_in(run.events)]
    return names if len(names) == size else [_("innovation {k}", k=k) for k in range(size)]


def _correction_indices(run: Run, size: int) -> list[int]:
    """Return the entries of an innovation that correct the estimate; all if the run does not contain their counts."""
    counts = [count.reading_count for count in rejections_in(run.events)]
    return [k for k in range(size) if len(counts) != size or counts[k] > 0]
