"""The message `identify` with the information of a drive, for a script."""

import math
from typing import Any

ROWS = [  # path, label in both languages, value, unit
    ("friction.quadratic[1]", ("drag sideways, ∝ v²", "rozamiento lateral, ∝ v²"), 2.1, "N s²/m²"),
    ("friction.quadratic[0]", ("drag forward, ∝ v²", "rozamiento al avanzar, ∝ v²"), 0.84, "N s²/m²"),
    ("friction.linear[1]", ("drag sideways", "rozamiento lateral"), 40.2, "N s/m"),
    ("friction.coulomb[0]", ("dry friction forward", "fricción seca al avanzar"), 0.248, "N"),
    ("friction.linear[0]", ("drag forward", "rozamiento al avanzar"), 3.3, "N s/m"),
    ("friction.quadratic[2]", ("drag in turning, ∝ r²", "rozamiento al girar, ∝ r²"), 0.0003, "N m s²/rad²"),
    ("actuator_matrix[0,0]", ("motor force", "fuerza motriz"), 3.38, "N/u"),
    ("friction.coulomb[2]", ("dry friction in turning", "fricción seca al girar"), 0.01, "N m"),
    ("drivetrain.lag_s", ("lag of the motors", "retardo de los motores"), 0.06, "s"),
    ("friction.linear[2]", ("drag in turning", "rozamiento al girar"), 0.0115, "N m s/rad"),
    (
        "drivetrain.dead_zone_forward[1]",
        ("dead zone forward, motor 2", "zona muerta adelante, motor 2"),
        0.27,
        "u",
    ),
    ("actuator_matrix[2,2]", ("motor torque", "par motor"), 0.203, "N m/u"),
    (
        "drivetrain.dead_zone_backward[0]",
        ("dead zone backward, motor 1", "zona muerta atrás, motor 1"),
        0.34,
        "u",
    ),
    (
        "drivetrain.dead_zone_backward[1]",
        ("dead zone backward, motor 2", "zona muerta atrás, motor 2"),
        0.29,
        "u",
    ),
]


def fit_taught(language: str, live: bool) -> dict[str, Any]:
    """Return the information of a drive of 26 s: one parameter is poorly known, one is unobservable."""
    k = 0 if language == "en" else 1
    needs = ("missing: sliding sideways both slowly and fast, as in turns at many speeds",
             "falta: deslizar de costado tanto despacio como rápido, como en curvas a muchas velocidades")  # fmt: skip
    now = [min(0.9, 10 ** (-0.35 - 0.27 * j)) for j in range(len(ROWS))]
    fit = {
        "t": 24.0, "took_s": 0.31, "value": [None, *(row[2] for row in ROWS[1:])],
        "std": [None, *(1.7 * std for std in now[1:])], "verdict": "USABLE", "verdict_id": "USABLE",
        "reason": None,
    }  # fmt: skip
    rate = [round(60 * math.exp(-j / 14) + 3 * (1 + math.sin(0.3 * j)), 2) for j in range(130)]
    motion = ("drive straight in short pulses, forward and then backward, 4 s",
              "maneje derecho a impulsos, hacia adelante y después hacia atrás, 4 s")  # fmt: skip
    word = {
        "of": "live", "t": 26.0, "start": 0.0 if not live else 34.0, "dt": 0.2, "rate": rate, "bits": 117.3, "std": now,
        "former_std": [min(1.0, 1.35 * std) for std in now], "compiled": True, "busy": False, "first": 8.0,
        "reason": None, "fit": fit,
        "parameters": [
            {"path": path, "label": label[k], "unit": unit, "guess": value, "needs": None if j else needs[k]}
            for j, (path, label, value, unit) in enumerate(ROWS)
        ],
        "next": {"motion": motion[k], "label": ROWS[1][1][k], "from": 0.29, "to": 0.13},
    }  # fmt: skip
    if live:
        return {"type": "identify"} | word
    deviations = [[min(1.0, std * (41.6 / (0.4 * (j + 1))) ** 0.5) for std in now] for j in range(104)]
    return word | {"expected": deviations, "step_s": 0.4, "fits": [fit | {"t": 8.0}, fit]}
