"""Estimators judged against the model and against plain integration: recordings, and an independent truth."""

from collections.abc import Callable, Sequence

from baqueano.study.estimation.judging import judged
from baqueano.study.estimation.result import Estimated
from baqueano.study.estimation.subjects import SETUPS, SUBJECTS, missing
from baqueano.study.recordings import check_present

__all__ = ["Estimated", "estimation"]


def estimation(
    backend: str = "auto",
    say: Callable[[str], object] = lambda text: None,
    names: Sequence[str] = (),
    kinds: Sequence[str] = (),
) -> Estimated:
    """Judge estimators on the recordings `names`, all without any; `kinds` are those of the estimators, else the
    file's. FileError, with the names of the files, where no recording is there."""
    out, left_out = [], []
    for name in names or SUBJECTS:
        if files := missing(name):
            left_out.append(f"{name} is left out: there is no {files[0]}; set BAQUEANO_DATA to its folder")
            continue
        for subject in SUBJECTS[name][0]():
            for sensors in SETUPS:
                say(f"{subject.name}, {sensors}: fitting {subject.fitted.duration_s:.0f} s, judging others")
                out += judged(subject, sensors, kinds, backend)
    if not out:
        check_present()
    return Estimated(tuple(out), left_out=tuple(left_out))
