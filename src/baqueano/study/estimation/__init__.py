"""Evaluate estimators against the model and plain integration, on recordings and on an independent truth."""

from collections.abc import Callable, Sequence

from baqueano.messages.language import translate as _
from baqueano.study.estimation import simulated as independent
from baqueano.study.estimation.evaluation import evaluate
from baqueano.study.estimation.result import EstimationStudy
from baqueano.study.estimation.subjects import SENSOR_SETS, SUBJECTS, missing_files
from baqueano.study.recordings import check_cpm_present, exclusion_sentence

SIMULATED = "simulated"
CASES = (*SUBJECTS, SIMULATED)


def estimation(
    seeds: int = 0,
    backend: str = "auto",
    progress: Callable[[str], object] = lambda text: None,
    cases: Sequence[str] = CASES,
    kinds: Sequence[str] = (),
    processes: int = 1,
) -> EstimationStudy:
    """Evaluate estimators on the recordings among `cases`, and on `seeds` simulated vehicles. `kinds` are kinds of
    estimator, else the file's. Raise FileError with the names of the files if nothing can be evaluated."""
    case_outcomes, left_out = [], []
    for name in (name for name in cases if name in SUBJECTS):
        if files := missing_files(name):
            left_out.append(exclusion_sentence(name, files))
            continue
        for subject in SUBJECTS[name][0]():
            for sensors in SENSOR_SETS:
                progress(
                    _(
                        "{name}, {sensors}: fitting {duration_s:.0f} s, testing on others",
                        name=subject.name,
                        sensors=sensors,
                        duration_s=subject.fit_run.duration_s,
                    )
                )
                case_outcomes += evaluate(subject, sensors, kinds, backend)
    if not (seeds and SIMULATED in cases):
        if not case_outcomes:
            check_cpm_present()
        return EstimationStudy(tuple(case_outcomes), notes=tuple(left_out))
    progress(_("simulating, fitting and testing {seeds} vehicles", seeds=seeds))
    outcomes = independent.simulate_outcomes(seeds, kinds, backend, processes)
    rows, vehicle_rows = independent.rows(outcomes), independent.vehicle_rows(outcomes)
    return EstimationStudy(
        tuple(case_outcomes),
        tuple(rows),
        tuple(vehicle_rows),
        (*left_out, independent.count_sentence(outcomes)),
    )
