"""Compare mean, standard and Allan deviation of a real MPU-6050, at rest for ten minutes, with published values.

The author of the recording published mean and standard deviation of each axis, to six digits. Here they are computed
again from the imported file, in the author's units. The Allan deviation over 1 s is compared with the result of an
independent implementation at the mean rate (0.0129, 0.0092, 0.0094 °/s).
"""

import csv
from collections.abc import Callable

import numpy as np

from baqueano.calibration.at_rest import measure_at_rest
from baqueano.contracts.values import JsonObject, TableRow
from baqueano.messages.language import mark as N_, number, translate as _
from baqueano.runs.importing import import_run
from baqueano.runs.maps.column_map import load_map
from baqueano.signals import STANDARD_GRAVITY
from baqueano.study.recorded.criteria import criterion_row, message_row
from baqueano.study.recordings import recorded_path

MAP = "mpu6050"
PUBLISHED_FILE = "mpu6050_sunsided/unmoved-with-x-pointing-forward-10min.author-stats.csv"
ALLAN_1S = (0.0129, 0.0092, 0.0094)  # °/s
ROUNDING = 5e-5  # of the author's value: four digits
ALLAN_TOLERANCE = 0.03
SI_FACTORS = {"accelerometer": STANDARD_GRAVITY, "gyro": np.pi / 180.0}
AXES = "XYZ"


def rows(progress: Callable[[str], None] = lambda text: None, backend: str = "auto") -> list[TableRow]:
    """Return the rows of the study, with recording, quantity, value, criterion and ok."""
    progress(_("MPU-6050 at rest, 11 min"))
    statistics = measure_at_rest(import_run(MAP).run)
    author = _published_statistics()
    study_rows = []
    for c in statistics.channels:
        unit = "g" if c.sensor == "accelerometer" else "°/s"
        kind = "accelerometer" if c.sensor == "accelerometer" else "gyroscope"
        pair = author[kind, AXES[c.entry]]
        for statistic, value, criterion in ((N_("mean"), c.mean, pair[0]), (N_("deviation"), c.std, pair[1])):
            quantity = f"{_(c.sensor)} {AXES[c.entry]}, {_(statistic)} [{unit}]"
            study_rows.append(_row(quantity, value / SI_FACTORS[c.sensor], criterion, ROUNDING))
    for c in (c for c in statistics.channels if c.sensor == "gyro"):
        assert c.allan_1s is not None
        name = _("gyro {axis}, Allan deviation at 1 s [°/s]", axis=AXES[c.entry])
        study_rows.append(_row(name, c.allan_1s / SI_FACTORS["gyro"], ALLAN_1S[c.entry], ALLAN_TOLERANCE))
    is_reported = any(finding.code == "at-rest.bursts" for finding in statistics.findings)
    return [*study_rows, message_row(MAP, _("burst stamps are reported"), is_reported)]


def _row(quantity: str, value: float, reference: float, tolerance: float) -> JsonObject:
    """Return a row that requires `value` to be within a fraction `tolerance` of the author's value `reference`."""
    ok = bool(abs(value - reference) <= tolerance * abs(reference) + (5e-7 if tolerance == ROUNDING else 0.0))
    criterion = f"{number(reference):g} ± {number(100 * tolerance):g} %"
    return criterion_row(MAP, quantity, value, criterion, ok)


def _published_statistics() -> dict[tuple[str, str], tuple[float, float]]:
    """Return (sensor, axis) → mean and standard deviation, in g and °/s."""
    with recorded_path(PUBLISHED_FILE).open(encoding="utf-8") as stream:
        return {
            (row["type"], row["axis"]): (float(row["v_mean"]), float(row["v_std_dev"]))
            for row in csv.DictReader(stream)
            if row["sensor"] == "MPU6050"
        }


def files() -> list[str]:
    """Return the names of the files that this study reads."""
    return [*(spec.path for spec in load_map(MAP).files.values() if spec.path), PUBLISHED_FILE]
