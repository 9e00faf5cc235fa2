"""The page about the recordings: what each fit found, the models on runs they have not seen, the paths."""

from baqueano.report import figures
from baqueano.report.of_estimate import errors, paths
from baqueano.report.page import Headline, Page, Section, Table, draw
from baqueano.study.recordings import Recorded
from baqueano.study.two_ways import CAVEATS, Judgement, TwoWays

CHANNELS = ("speed, odometer [m/s]", "yaw rate, gyro [rad/s]")
SHOWN_S = 30.0


def page_of_recordings(found: Recorded | None, study: TwoWays | None) -> Page:
    """The table of all recordings; then the car that was driven twice, both ways round: tables, and for each run
    that was held out the model, the path and the errors."""
    sections, headlines = [], []
    if found is not None:
        said = "\n".join((*found.reasons, *found.left_out))
        sections.append(
            Section(
                "All recordings", said, [Table(found.rows(), "Each judged on what the fit has not seen.")]
            )
        )
    if study is not None:
        held_out = [one for one in study.judged if one.held_out]
        said = "\n".join((*study.reasons, *study.notes))
        sections.append(
            Section("A car of 1:18: models on runs", said, [Table(study.figures(), " ".join(CAVEATS))])
        )
        sections.append(Section("Parameters", "Fitted to one run each.", [Table(study.parameters())]))
        for one in held_out:
            sections += sections_of(one)
            headlines += _headlines(one)
    result = found or study
    assert result is not None
    return Page(
        title="Real vehicles, judged on what their models have not seen",
        subtitle="Recordings that others made; the car of 1:18 is the CPM Lab's µCar under an overhead camera",
        verdict=result.verdict,
        headlines=headlines,
        sections=sections,
        reproduce="baqueano study recordings",
    )


def sections_of(one: Judgement) -> list[Section]:
    """A model on a run."""
    title = f"Fitted on {one.fitted_on}, judged on {one.judged_on}"
    t_s, measured, model = one.predicted
    first = t_s <= t_s[0] + SHOWN_S
    drawing = figures.channels(t_s[first], measured[first], model[first], CHANNELS)
    drawn = draw(drawing, f"The first {SHOWN_S:.0f} s. The model sees the commands alone.")
    said = (
        "The EKF begins at the camera's first pose and sees IMU and odometer: nothing on board measures a "
        "position. Shaded: where it believes the car to be, with 95 % probability."
    )
    return [Section(f"{title}: the model", "", [drawn]), Section(f"{title}: the path", said, paths(one.replayed)),
            *errors(one.replayed)]  # fmt: skip


def _headlines(one: Judgement) -> list[Headline]:
    row, way = one.row(), f"{one.fitted_on} → {one.judged_on}"
    off = f"{100 * row['ate_m'] / row['driven_m']:.2g} % of the {row['driven_m']:.0f} m driven"
    part = f"yaw rate {100 * row['yaw_rate_explained']:.1f} %"
    return [
        Headline(f"position error, {way}", f"{100 * row['ate_m']:.1f} cm", f"rms, {off}"),
        Headline(f"speed explained, {way}", f"{100 * row['speed_explained']:.1f} %", part),
    ]
