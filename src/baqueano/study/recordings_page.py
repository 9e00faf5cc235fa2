"""Write the page about the recordings: results of each fit, models on held-out runs, and paths."""

from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.report import figures
from baqueano.report.estimate_report import errors, paths
from baqueano.report.page import Headline, Page, Section, Table, draw
from baqueano.study.cross_validation_cpm import CAVEATS, CrossValidation, RunEvaluation
from baqueano.study.recordings import RecordingStudy

CHANNELS = (N_("speed, odometer [m/s]"), N_("yaw rate, gyro [rad/s]"))
SHOWN_S = 30.0


def make_recordings_page(recordings: RecordingStudy | None, study: CrossValidation | None) -> Page:
    """Return the page: the table of all recordings, then the tables of the car that was driven twice.
    For each held-out run the page shows the model, the path and the errors.
    """
    sections, headlines = [], []
    if recordings is not None:
        text = "\n".join((*recordings.reasons, *recordings.missing_recordings))
        sections.append(
            Section(
                _("All recordings"),
                text,
                [Table(recordings.rows(), _("Each fit is tested with data that it did not use."))],
            )
        )
    if study is not None:
        held_out = [run_evaluation for run_evaluation in study.evaluations if run_evaluation.is_held_out]
        text = "\n".join((*study.reasons, *study.notes))
        sections.append(
            Section(
                _("1:18 car: the models on each run"),
                text,
                [Table(study.figures(), " ".join(map(_, CAVEATS)))],
            )
        )
        sections.append(
            Section(_("Parameters"), _("Each fit used a single run."), [Table(study.parameters())])
        )
        for run_evaluation in held_out:
            sections += evaluation_sections(run_evaluation)
            headlines += _headlines(run_evaluation)
    result = recordings or study
    assert result is not None
    return Page(
        title=_("Real vehicles, tested with data that their models did not use"),
        subtitle=_("Recordings made by others; the 1:18 car is the CPM Lab's µCar under an overhead camera"),
        verdict=result.verdict,
        headlines=headlines,
        sections=sections,
        reproduce="baqueano study recordings",
    )


def evaluation_sections(run_evaluation: RunEvaluation) -> list[Section]:
    """Return the sections of the page on the evaluation of a model on a run."""
    title = _(
        "Fitted on {fit_run}, tested on {test_run}",
        fit_run=run_evaluation.fit_run,
        test_run=run_evaluation.test_run,
    )
    t_s, measured_values, model = run_evaluation.prediction
    is_shown = t_s <= t_s[0] + SHOWN_S
    drawing = figures.channels(
        t_s[is_shown], measured_values[is_shown], model[is_shown], [_(name) for name in CHANNELS]
    )
    drawings = draw(
        drawing, _("The first {shown_s:.0f} s. The model uses only the commands.", shown_s=SHOWN_S)
    )
    text = _(
        "The EKF begins at the camera's first pose and uses IMU and odometer: no sensor on board measures "
        "a position. Shaded: the region that contains the car with 95 % probability, according to the EKF."
    )
    return [
        Section(_("{title}: the model", title=title), "", [drawings]),
        Section(_("{title}: the path", title=title), text, paths(run_evaluation.replay_run)),
        *errors(run_evaluation.replay_run),
    ]


def _headlines(run_evaluation: RunEvaluation) -> list[Headline]:
    row, title = run_evaluation.row(), f"{run_evaluation.fit_run} → {run_evaluation.test_run}"
    position_text = _(
        "{percent:.2g} % of the {driven_m:.0f} m driven",
        percent=100 * row["ate_m"] / row["distance_m"],
        driven_m=row["distance_m"],
    )
    yaw_rate_text = _("yaw rate {percent:.1f} %", percent=100 * row["yaw_rate_explained"])
    return [
        Headline(
            _("position error, {way}", way=title),
            f"{number(100 * row['ate_m']):.1f} cm",
            _("rms, {off}", off=position_text),
        ),
        Headline(
            _("speed explained, {way}", way=title),
            f"{number(100 * row['speed_explained']):.1f} %",
            yaw_rate_text,
        ),
    ]
