"""The result of `study estimation`: each estimator and its references, on each recording and pooled.

    pooled ratio     √(Σ e² / Σ ẽ²) over all recordings, its interval by drawing whole blocks            (1)
    typical ratio    the geometric mean of the ratios of the recordings                                  (2)

A large error has more weight in (1); all recordings have equal weight in (2). The requirements are for (1), and for
single recordings: their ratio must not be significantly above MAX_SINGLE_RATIO. A refused fit is not written, and its
recording does not have a requirement.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Verdict
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.study.estimation.errors import QUANTITIES, SPEED, merge
from baqueano.study.estimation.subjects import BOTH

if TYPE_CHECKING:
    from baqueano.study.estimation.evaluation import EstimateEvaluation

REFUSED = Verdict.REFUSED
MAX_SINGLE_RATIO = 1.10
MAX_POOLED_RATIO, SPEED_WITH_ODOMETER, GOAL_RATIO = 1.0, 0.7, 0.7
NEES_RANGE, NIS_RANGE, MAX_AUTOCORRELATION = (0.4, 1.6), (0.85, 1.15), 0.12  # required of a recording
REFERENCE_NAMES = {
    True: N_("the model from the commands alone"),
    False: N_("plain integration with the same calibration"),
}


@dataclass(frozen=True, slots=True)
class EstimationStudy:
    """The evaluated recordings, and the evaluated robots and cars of the independent truth."""

    estimates: tuple["EstimateEvaluation", ...]
    simulated_rows: tuple[JsonObject, ...] = ()  # rows: the fraction of vehicles that are not worse
    vehicles: tuple[JsonObject, ...] = ()  # rows: one for each vehicle, only for machine use
    notes: tuple[str, ...] = ()  # sentences on what was not evaluated

    def rows(self) -> list[TableRow]:
        """Return all rows: recording, estimator, quantity, value, reference, ok; for a ratio also ratio, low, high."""
        return [*self.rows_shown(), *self.vehicles]

    def rows_shown(self) -> list[TableRow]:
        """Return all rows except the rows of single simulated vehicles."""
        case_rows = [
            row | ({"ok": None} if estimate.fit == REFUSED else {})
            for estimate in self.estimates
            for row in (*_evaluation_rows(estimate), *_consistency_rows(estimate))
        ]
        return [*case_rows, *self.pooled_ratios(), *self.simulated_rows]

    def pooled_ratios(self) -> list[TableRow]:
        """Return the pooled and the typical ratio for each set of sensors, estimator and quantity, with the limit."""
        ratio_rows = []
        groups: dict[tuple[str, str], list[EstimateEvaluation]] = {}
        for estimate in self.estimates:
            if estimate.fit != REFUSED:
                groups.setdefault((estimate.sensors, estimate.estimator), []).append(estimate)
        for (sensors, estimator), estimates in groups.items():
            recordings = _("all, {sensors}", sensors=sensors)
            for quantity in QUANTITIES:
                errors = [estimate.errors[quantity] for estimate in estimates]
                ratio, low, high = merge(errors).ratio
                limit = SPEED_WITH_ODOMETER if (quantity, sensors) == (SPEED, BOTH) else MAX_POOLED_RATIO
                mean_ratio = float(np.exp(np.mean([np.log(error.ratio[0]) for error in errors])))
                for name, value in ((N_("pooled"), ratio), (N_("typical"), mean_ratio)):
                    label = _("{quantity}, {name} ratio", quantity=_short_name(quantity), name=_(name))
                    cells = row(recordings, estimator, label, value, limit)
                    ratio_rows.append(cells | {"ratio": value, "low": low, "high": high})
                ratio_rows[-1] |= {"low": float("nan"), "high": float("nan")}
        return ratio_rows

    @property
    def reasons(self) -> tuple[str, ...]:
        """Return a sentence for each replay that stopped and each requirement that is missed."""
        stops = [
            f"{estimate.recording}, {estimate.estimator}: {estimate.stop_reason}"
            for estimate in self.estimates
            if estimate.stop_reason
        ]
        misses = [r for r in self.rows_shown() if r["ok"] is False and "typical" not in r["quantity"]]
        figures = (r | {"quantity": _short_name(r["quantity"]), "times": _ratio_text(r)} for r in misses)
        return (*stops, *(_("{recording}, {estimator}: {quantity} is {times}", **r) for r in figures))

    @property
    def verdict(self) -> Verdict:
        """Return WARN if a requirement is missed or a replay stopped, else USABLE."""
        return Verdict.WARN if self.reasons else Verdict.USABLE

    def table(self) -> str:
        """Return the rows, notes and verdict as a text table."""
        rows = self.rows_shown()
        names = [_("recording"), _("estimator"), _("quantity")]
        head = [*names, _("value"), _("ref."), _("ratio"), "95 %", ""]
        refused_recordings = dict.fromkeys(e.recording for e in self.estimates if e.fit == REFUSED)
        refusal_text = N_("{recording}: its fit is {verdict}, so it is shown but not counted.")
        checks = [r["ok"] for r in rows if r["ok"] is not None]
        figures = {"verdict": _(self.verdict), "met": sum(checks), "all": len(checks)}
        return "\n".join(
            [
                *text_table("<<<>>><<", head, *map(_cells, rows)),
                *_legend(),
                *(f"{e.recording}, {e.estimator}: {e.consistency.sentence}" for e in self.estimates),
                *self.notes,
                *(_(refusal_text, recording=name, verdict=_(REFUSED)) for name in refused_recordings),
                _("{verdict}: {met} of {all} requirements are met", **figures),
            ]
        )


def _cells(r: TableRow) -> list[str]:
    """Return the cells of a row of the table."""
    interval = _(r["verdict"]) if "verdict" in r else ""
    if not interval and np.isfinite(r.get("low", float("nan"))):
        interval = f"[{number(r['low']):.2f}, {number(r['high']):.2f}]"
    names = [_(r[key]) for key in ("recording", "estimator", "quantity")]
    ratio = f"{number(r['ratio']):.2f}" if "ratio" in r else ""
    value, reference = (f"{number(r[key]):.3f}" for key in ("value", "reference"))
    return [*names, value, reference, ratio, interval, _("NO") if r["ok"] is False else ""]


def _legend() -> list[str]:
    """Return the sentences on the references and the limits of the table."""
    names = {"speed": _(REFERENCE_NAMES[True]), "position": _(REFERENCE_NAMES[False])}
    return [
        _("Reference of a speed: {speed}. Of a position: {position}.", **names),
        _(
            "NO marks a ratio on one recording that is significantly above {alone:g}, or a requirement "
            "that is not met. The goal of a pooled ratio is {goal:g}.",
            alone=MAX_SINGLE_RATIO,
            goal=GOAL_RATIO,
        ),
        _(
            "The NEES of a speed must be in {nees}, the NIS in {nis}, and the lag-1 correlation within "
            "± {white:g}.",
            nees=NEES_RANGE,
            nis=NIS_RANGE,
            white=MAX_AUTOCORRELATION,
        ),
    ]


def row(recording: str, estimator: str, quantity: str, value: float, limit: float) -> JsonObject:
    """Return a row with a value, its limit `limit`, and True if the value is at most the limit."""
    return {
        "recording": recording, "estimator": estimator, "quantity": quantity, "value": value, "reference": limit,
        "ok": bool(value <= limit),
    }  # fmt: skip


def _evaluation_rows(estimate: "EstimateEvaluation") -> list[TableRow]:
    rows = []
    for quantity, errors in estimate.errors.items():
        (value, reference), (ratio, low, high) = errors.rms, errors.ratio
        cells = row(estimate.recording, estimate.estimator, quantity, value, reference)
        ok = None if not np.isfinite(low) else bool(low <= MAX_SINGLE_RATIO)
        rows.append(cells | {"ok": ok, "ratio": ratio, "low": low, "high": high})
    return rows


def _consistency_rows(estimate: "EstimateEvaluation") -> list[TableRow]:
    """Return rows with NEES and NIS compared with 1, and the lag-1 autocorrelation of each innovation with 0."""
    consistency, rows = estimate.consistency, []
    figures = {
        _("NEES of the pose"): (consistency.nees_pose, None),
        _("NEES of the speed"): (estimate.nees_speed, NEES_RANGE),
    }
    figures |= {
        _("NIS of {channel}", channel=name): (band, NIS_RANGE) for name, band in consistency.channels.items()
    }
    for name, (band, limit) in figures.items():
        ok = bool(limit[0] <= band.mean <= limit[1]) if limit and np.isfinite(band.mean) else None
        cells = row(estimate.recording, estimate.estimator, name, band.mean, 1.0)
        rows.append(cells | {"ok": ok, "verdict": band.verdict})
    for channel, value in zip(consistency.channels, consistency.correlations, strict=True):
        name = _("lag-1 correlation of {channel}", channel=channel)
        cells = row(estimate.recording, estimate.estimator, name, value, 0.0)
        rows.append(cells | {"ok": bool(abs(value) <= MAX_AUTOCORRELATION)})
    return rows


def _short_name(quantity: str) -> str:
    return _(quantity).partition(" [")[0]


def _ratio_text(row: TableRow) -> str:
    ratio = row.get("ratio", row["value"])
    return f"{number(ratio):.2f}" if ratio == row["value"] else _("{ratio:.2f} × the reference", ratio=ratio)
