"""Convert the truth of a camera to the body: pose of the camera's target on the vehicle, and shift of its timestamps.

    p = p_m − R(ψ) l,   ψ = ψ_m − χ                                                                       (1)
    ν_x, ν_y = R(χ) ν_m − ν_ψ × l                                                                         (2)
    l = l₁ + R(χ₁) l₀,   χ = χ₁ + χ₀,   o = o₁ + o₀                                                       (3)

l is the position of the target in the body frame (forward, left). χ is its rotation to the left, and o the time shift,
from [truth] in the map of a recording. A run is imported with the mount l₀, χ₀, o₀. (3) adds the mount l₁, χ₁, o₁ that
is estimated from this run.
"""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baqueano.atomic_file import replace_file
from baqueano.contracts.values import JsonObject
from baqueano.errors import FileError, Invalid, UsageError
from baqueano.geometry import map_from_body, wrap
from baqueano.messages.printable import baqueano_command
from baqueano.runs.run import Run

KEY_TYPES: dict[str, type] = {"shift_s": float, "lever_arm_m": list, "heading_rad": float}


class Mount(NamedTuple):
    """The pose of the camera's target on the vehicle, and the shift of the camera's clock."""

    shift_s: float = 0.0  # added to its timestamps
    lever_arm_m: tuple[float, float] = (0.0, 0.0)
    heading_rad: float = 0.0

    def body_motion(self, eta: np.ndarray, nu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return η and ν (N, 3) of the body from η and ν of the target; an unknown `nu` is NaN.  (1), (2)"""
        if self.lever_arm_m == (0.0, 0.0) and self.heading_rad == 0.0:
            return eta, nu
        psi, (forward, left) = eta[:, 2] - self.heading_rad, self.lever_arm_m
        c, s = np.cos(psi), np.sin(psi)
        eta = np.column_stack(
            [eta[:, 0] - c * forward + s * left, eta[:, 1] - s * forward - c * left, wrap(psi)]
        )
        body_nu = nu @ map_from_body(self.heading_rad).T
        return eta, body_nu - nu[:, 2:] * np.array([-left, forward, 0.0])

    def compose(self, offset: "Mount") -> "Mount":
        """Return this mount plus the `offset` that was estimated from a run imported with this mount.  (3)"""
        first = map_from_body(offset.heading_rad)[:2, :2] @ np.array(self.lever_arm_m)
        forward, left = np.array(offset.lever_arm_m) + first
        return Mount(
            self.shift_s + offset.shift_s,
            (float(forward), float(left)),
            self.heading_rad + offset.heading_rad,
        )


def parse_mount(spec: JsonObject, is_heading_known: bool = True) -> Mount:
    """Return the mount of a table [truth]. Raise Invalid if its lever arm is not two finite numbers, or if the mount
    needs a heading that is not known.
    """
    lever = spec.get("lever_arm_m", [0.0, 0.0])
    are_numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for x in lever)
    if len(lever) != 2 or not are_numbers or not np.isfinite(lever).all():
        raise Invalid.of("expect.lever-arm")
    shift_s, heading_rad = (float(spec.get(key, 0.0)) for key in ("shift_s", "heading_rad"))
    mount = Mount(shift_s, (float(lever[0]), float(lever[1])), heading_rad)
    if not is_heading_known and mount != Mount(shift_s):
        raise Invalid.of("expect.no-mount")
    return mount


def write_mount(path: Path | str, run: Run, own_mount: dict[str, float], halves: dict[str, float]) -> Mount:
    """Write the calibration `own_mount` of the truth into the map at `path`, with which `run` was imported.
    The names are KEY_TYPES, and lever_arm_m[0] and lever_arm_m[1] for the lever arm. `halves` are the half widths of
    the 95 % intervals. The rest of the file is unchanged. Raise UsageError if the run was imported with another map, if
    `path` is not a file, or if tomlkit is not installed. Return the new mount.
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError.of("map.not-file", "--map MAP.toml", path=path, run=run.name)
    try:
        import tomlkit
    except ImportError as error:
        raise UsageError.of("map.no-tomlkit", "pip install tomlkit") from error
    text = path.read_text(encoding="utf-8-sig")
    old_table = _truth_table(text, path.name)
    if _truth_table(run.metadata.get("map_text", ""), run.name) != old_table or not old_table:
        raise UsageError.of(
            "map.other-truth",
            baqueano_command("runs", "import", path.name, "RECORDING"),
            map=path.name,
            run=run.name,
        )
    lever = own_mount.get("lever_arm_m[0]", 0.0), own_mount.get("lever_arm_m[1]", 0.0)
    new_mount = Mount(own_mount.get("shift_s", 0.0), lever, own_mount.get("heading_rad", 0.0))
    mount, document = parse_mount(old_table).compose(new_mount), tomlkit.parse(text)
    for key in (key for key in KEY_TYPES if any(name.startswith(key) for name in own_mount)):
        errors = ", ".join(f"{half_width:.2g}" for name, half_width in halves.items() if name.startswith(key))
        _set_value(
            document["truth"], key, getattr(mount, key), f"± {errors} (95 %), runs calibrate {run.name}"
        )
    replace_file(path, tomlkit.dumps(document))
    return mount


def _set_value(table: Any, key: str, value: Any, text: str) -> None:
    """Set a number or a list of two numbers in a table of tomlkit, with a comment if the table is not inline."""
    table[key] = [round(x, 5) for x in value] if isinstance(value, tuple) else round(value, 5)
    if type(table).__name__ != "InlineTable":
        table[key].comment(text)


def _truth_table(text: str, name: str) -> JsonObject:
    try:
        return tomllib.loads(text).get("truth", {})
    except tomllib.TOMLDecodeError as error:
        raise FileError.of("map.not-toml", path=name, error=str(error)) from error
