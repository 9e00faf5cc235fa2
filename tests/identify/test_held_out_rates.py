"""How often held-out runs cannot tell, by their length. On the independent truth, with the model that is right.

Of 30 drives by steps of 1 s all have too few pieces of motion in 8 s, 7 in 10 s, 2 in 12 s and none from 15 s on. A run
of ADVISED_S suffices: so the message says, and there at most one in ten may be undecided.
"""

from collections import Counter

import pytest

from baqueano.identify import FitOptions, identify
from baqueano.identify.validation import ADVISED_S, validate
from tests.identify.true_drives import case_drives, case_file

pytestmark = pytest.mark.long

DRIVES = 20


@pytest.fixture(scope="module")
def drives():
    """Case study I: a run to fit, and those that are held out."""
    return case_drives(range(1 + DRIVES), 30.0, case_file())


@pytest.fixture(scope="module")
def fit(drives):
    return identify(drives[0].run, drives[0].file, options=FitOptions(diagnose=False))


def verdicts(fit, drives, span_s):
    """How often each verdict was given on the first `span_s` of the held-out runs."""
    return Counter(validate(fit, drive.run.cut(0.0, span_s)).verdict for drive in drives[1:])


@pytest.mark.parametrize("span_s", [ADVISED_S, 2.0 * ADVISED_S])
def test_runs_of_the_advised_length_are_judged_and_the_right_model_is_usable(fit, drives, span_s):
    """CHANCE for each of three channels makes 0.6 WARN of 20 runs; more than 2 come by chance once in 40 times."""
    count = verdicts(fit, drives, span_s)
    assert count["CANNOT TELL"] <= DRIVES / 10
    assert count["REFUSED"] == 0
    assert count["WARN"] <= 2


@pytest.mark.parametrize("span_s", [3.0, 8.0])
def test_runs_with_too_few_pieces_are_never_usable(fit, drives, span_s):
    assert verdicts(fit, drives, span_s) == {"CANNOT TELL": DRIVES}
