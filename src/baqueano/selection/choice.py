"""Result of `choose`: the terms of a model, with the reason, a sentence and the values for each."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from baqueano.contracts.optional import has_field
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.diagnostics import Diagnostic, note
from baqueano.identify.data.record import FittedBlocks
from baqueano.identify.options import FitOptions
from baqueano.identify.result.fit_result import Fit
from baqueano.messages import text
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.messages.text_table import text_table
from baqueano.selection.terms import Term
from baqueano.sensors.sampling import is_imu
from baqueano.vehicle_file import VehicleFile

NO_EVIDENCE = N_(
    "One step ahead every model is good, because it starts from the previous sample. Such scores "
    "prove nothing, and were not used."
)


class ChannelLabel(NamedTuple):
    """Name and unit of a channel."""

    name: str  # "speed"
    unit: str


def channel_labels(blocks: "FittedBlocks") -> list[ChannelLabel]:
    """Return the labels of the entries of all sensors, in order."""
    labels = []
    for name, sensor in blocks.sensors._asdict().items():
        if is_imu(sensor):
            names = N_("acceleration"), N_("lateral acceleration"), N_("yaw rate")
            labels += map(ChannelLabel, names, ("m/s²", "m/s²", "rad/s"))
        elif has_field(sensor, "radius_scale"):
            labels += [
                ChannelLabel(name, "m/s") for name in (N_("left wheel's speed"), N_("right wheel's speed"))
            ]
        elif sensor.size == 1 and has_field(sensor, "scale"):
            labels.append(ChannelLabel(N_("speed"), "m/s"))
        elif sensor.size == 3 and name == "truth":
            names = N_("speed"), N_("sideways speed"), N_("yaw rate")
            labels += map(ChannelLabel, names, ("m/s", "m/s", "rad/s"))
        else:
            labels += [ChannelLabel(f"{name}[{k}]", "") for k in range(sensor.size)]
    return labels


class Decision(StrEnum):
    """Decision on a term."""

    ADDED = N_("added")
    EXCLUDED = N_("excluded")
    REFUSED = N_("refused")
    DROPPED = N_("dropped")


class TermResult(NamedTuple):
    """Result for one term. It is compared with the model of its round, or at the end with the model without this
    term."""

    term: Term
    verdict: Decision
    reason: Diagnostic | None  # the reason, if not only the values decided
    channel: ChannelLabel
    error_without: float  # held-out error of that channel
    error_with: float
    gain: float  # relative fall of the held-out error of a block, mean over blocks
    gain_std: float
    errors: float  # the gain in its standard errors
    required_errors: float  # standard errors that the rule requires
    estimate: tuple[float, ...]  # on all runs
    std: tuple[float, ...]  # by leaving folds out
    one_step_without: float
    one_step_with: float

    @property
    def message(self) -> Diagnostic:
        """Return the decision and its values as a message."""
        details: JsonObject = {"errors": self.errors, "threshold": self.required_errors}
        part = {"percent": 100 * self.gain, "percent_std": 100 * self.gain_std}
        name = self.term.name
        details["term"] = name
        if self.verdict == Decision.ADDED:
            details |= {"channel": self.channel.name, "unit": self.channel.unit}
            return note(
                "choose.taken",
                subject=name,
                first_error=self.error_without,
                last_error=self.error_with,
                **details,
            )
        if self.verdict == Decision.DROPPED:
            return note("choose.dropped", subject=name, **part, **details)
        if self.reason is not None:
            code = "choose.refused" if self.verdict == Decision.REFUSED else "choose.left-out-for"
            return note(code, subject=name, term=name, reason=self.reason)
        return note("choose.left-out", subject=name, **part, **details)

    def row(self) -> JsonObject:
        """Return the result as one flat row."""
        return {
            "term": self.term.name, "parameters": ", ".join(self.term.paths), "verdict": self.verdict,
            "channel": self.channel.name, "unit": self.channel.unit, "error_without": self.error_without,
            "error_with": self.error_with, "gain": self.gain, "gain_std": self.gain_std,
            "standard_errors": self.errors, "needed": self.required_errors, "estimate": list(self.estimate),
            "std": list(self.std), "one_step_without": self.one_step_without,
            "one_step_with": self.one_step_with, "text": text(self.message),
        }  # fmt: skip


@dataclass(frozen=True)
class Choice:
    """A model with the terms that held-out data support, and its fit."""

    # the last result for each term: first the terms in the model, in their order
    term_results: tuple[TermResult, ...]
    fit: "Fit" = field(repr=False)
    rule: str  # the held-out data, and the condition for a term

    @property
    def selected_terms(self) -> tuple[str, ...]:
        """Return the names of the terms in the model."""
        return tuple(result.term.name for result in self.term_results if result.verdict == Decision.ADDED)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return one sentence per term."""
        return tuple(text(result.message) for result in self.term_results)

    @property
    def verdict(self) -> str:
        """Return the verdict of the fit."""
        return self.fit.verdict

    @property
    def vehicle_file(self) -> VehicleFile:
        """Return the file with the chosen model."""
        return self.fit.vehicle_file

    @property
    def refit_arguments(self) -> JsonObject:
        """Return the arguments of `identify` that fit the chosen model again, from its values."""
        options = FitOptions(gyro_leads=False, backend=self.fit.backend)
        return {"free": list(self.fit.names), "options": options}

    def rows(self) -> list[TableRow]:
        """Return one flat row per term, then one per parameter of the fit."""
        return [result.row() for result in self.term_results] + self.fit.rows()

    def table(self, reported: bool = False) -> str:
        """Return the table as text; `reported` is passed to the table of the fit."""
        rows = []
        for result in self.term_results:
            errors = f"{number(result.error_without):.4g} → {number(result.error_with):.4g}"
            one_step = f"{number(result.one_step_without):.4g} → {number(result.one_step_with):.4g}"
            label = f"{_(result.channel.name)} [{result.channel.unit}]"
            rows.append([_(result.term.name), _(result.verdict), errors, one_step, label])
        lines = text_table("<<>><", [_("term"), "", _("held out"), _("one step ahead"), ""], *rows)
        lines += ["", *(f"- {sentence}" for sentence in self.sentences), "", self.rule, _(NO_EVIDENCE), ""]
        return "\n".join(lines) + "\n" + self.fit.table(reported)
