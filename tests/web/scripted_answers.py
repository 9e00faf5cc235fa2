"""Prepared answers of a worker to the requests of a page: gains and laps, blocks, comparisons."""

import math
from typing import Any

GAINS = [
    {
        "name": name,
        "unit": unit,
        "meaning": meaning,
        "low": 0.0,
        "high": high,
        "file": own,
        "value": own,
        "best": best,
    }
    for name, unit, meaning, high, own, best in (
        ("k_i", "1/s", "share of the error a second", 10.0, 0.5, 0.6),
        ("k_x", "1/s", "speed per along-track error e_x", 10.0, 1.0, 1.4),
        ("k_chi", "1/s", "yaw rate per course error e_χ", 20.0, 4.0, 6.0),
        ("join_m", "m", "way L in which the path is joined", 10.0, 0.25, 0.2),
    )
]
RUNS = [
    {
        "id": f"r{k}",
        "name": name,
        "kind": kind,
        "when": "2026-03-02 10:15",
        "seconds": 41.6,
        "laps": laps,
        "report": True,
    }
    for k, (name, kind, laps) in enumerate(
        [
            ("0042-repeat", "repeat", 3),
            ("0039-repeat", "repeat", 3),
            ("0038-teach", "teach", None),
            ("0037-experiment", "experiment", None),
        ]
    )
]


LIMIT = {"x": [1.2, -1.2, -1.2, 1.2, 1.2], "y": [2.3, 2.3, -0.2, -0.2, 2.3]}  # of the vehicle in its room


def route() -> dict[str, Any]:
    angles = [2 * math.pi * k / 120 for k in range(120)]
    return {
        "name": "lab",
        "closed": True,
        "x": [math.sin(a) for a in angles],
        "y": [1 - math.cos(a) for a in angles],
        "room": LIMIT,
    }


def answer_to(word: dict[str, Any]) -> dict[str, Any]:
    """Return the answer of a worker to a request, without a computation."""
    if word["question"] == "tune":
        about = {
            "gains": GAINS,
            "controller": "PdFeedforward",
            "routes": ["lab", "sinuous-circle"],
            "route": "lab",
        }
        return about | {
            "price": 0.1,
            "seconds": 20.8,
            "whole": True,
            "ticks": 2081,
            "path": route(),
            "file": "vehicle.toml",
        }
    if word["question"] == "route":
        return route() | {"name": word["route"], "x": [2.0 * x for x in route()["x"]]}
    if word["question"] == "lap":
        return lap_of(word["gains"])
    if word["question"] == "landscape":
        k = [gain["name"] for gain in GAINS]
        side, a, b = word["side"], k.index(word["a"]), k.index(word["b"])
        costs = []
        for j in range(side):
            for i in range(side):
                gains = list(word["gains"])
                for axis, position in ((a, i), (b, j)):
                    gains[axis] = GAINS[axis]["high"] * math.expm1(7 * position / (side - 1)) / math.expm1(7)
                lap = lap_of(gains)
                costs.append([lap["cost"], lap["jerk"]])
        return {"side": side, "costs": costs, "seconds": 0.4}
    if word["question"] == "downhill":
        best = [gain["best"] for gain in GAINS]
        path = [
            [g + part * (w - g) for g, w in zip(word["gains"], best, strict=True)]
            for part in (0, 0.4, 0.8, 1)
        ]
        places = [[math.log1p(g / gain["high"] * math.expm1(7)) / 7 for g, gain in zip(gains, GAINS, strict=True)]
                  for gains in path]  # fmt: skip
        costs = [lap_of(gains)["cost"] for gains in path]
        return {
            "path": path,
            "places": places,
            "cost": costs[-1],
            "start_cost": costs[0],
            "laps": 23,
            "seconds": 0.2,
        }
    if word["question"] == "block":
        return make_block(word["room"])
    if word["question"] == "check":
        return {"findings": []}
    if word["question"] == "compare":
        cells = [f"{0.01 * (k + 1):.3f}" for k in range(len(word["runs"]))]
        rows = [{"label": "distance, rms", "unit": "m", "cells": cells, "best": 0}]
        names = [run["name"] for run in RUNS if run["id"] in word["runs"]]
        sections = [{"title": "true cross-track error of the vehicle", "rows": rows * 3}]
        return {"names": names, "sections": sections, "reasons": []}
    return {}


def make_block(room: str) -> dict[str, Any]:
    """Return the answer of a worker about a block."""
    kinds = {
        "estimator": ["ekf", "augmented_ekf", "my_blocks.py:MyEkf"],
        "controller": ["pd", "lqr"],
        "guide": [],
    }
    text = "".join(f"line {k} of a file that is as long as one of ours, and as wide\n" for k in range(150))
    parameters = [
        {
            "name": "k_x",
            "unit": "1/s",
            "meaning": "speed per along-track error e_x",
            "value": [1.0],
            "shape": "",
        },
        {"name": "process_noise_cov", "unit": "m²", "meaning": "R", "value": None, "shape": "6 × 6"},
    ]
    return {
        "room": room, "kind": "augmented_ekf", "of_file": "augmented_ekf", "kinds": kinds.get(room, []),
        "name": "AugmentedEkf", "ours": True, "parameters": parameters, "file": "estimators/augmented_ekf.py",
        "text": text, "line": 70, "step_us": 21.4, "tick_us": 1e4, "swapped": None,
    }  # fmt: skip


def lap_of(gains: list[float]) -> dict[str, Any]:
    """Return a lap whose distance from its circle grows with the distance of the gains from their optimum."""
    gap = sum(math.log((g + 0.1) / (gain["best"] + 0.1)) ** 2 for g, gain in zip(gains, GAINS, strict=True))
    error = 0.01 + 0.02 * gap
    angles = [math.tau * k / 300 for k in range(300)]
    return {
        "x": [(1 + error * math.cos(3 * a)) * math.sin(a) for a in angles],
        "y": [1 - (1 + error * math.cos(3 * a)) * math.cos(a) for a in angles],
        "cost": 0.2 + 4.0 * gap,
        "jerk": 0.1 + gains[0] / 10, "rms": 0.7 * error, "most": error, "full": 0.03, "ms": 2.1,
    }  # fmt: skip
