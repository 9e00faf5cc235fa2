"""Whole turns by hand identify the scale of a gyro, with an interval of correct coverage.

The logs are simulated in this file without a model of the package: an uneven hand that returns to within 2°, a gyro
with a drifting bias. Of 200 intervals of 95 %, 180 to 198 contain the truth; the false-alarm rate is below 1 % for
correct code, with fixed seeds.
"""

import json
from dataclasses import replace

import numpy as np
import pytest

from baqueano.calibration.hand_turns import calibrate_by_hand_turns, is_turned_by_hand
from baqueano.cli import main
from baqueano.compare.corridor_forecast import forecast_corridor
from baqueano.errors import UsageError
from baqueano.guides.shapes import circle
from baqueano.identify import FitOptions, identify
from baqueano.runs import import_run, write_run
from baqueano.runs.run import Channel, Run
from baqueano.vehicle_file import load
from tests.codes import includes, of_code

SCALE, BIAS, RATE = 1.034, 0.015, 100
NAME = "sensors.imu.gyro_scale"


def by_hand_log(turns=(2, -2), seed=0, hand_deg=2.0, pause=False, rest_s=3.0, scale=SCALE, noise=0.004):
    """Return a log of a vehicle on its mark: rests, and turns of uneven speed."""
    rng = np.random.default_rng(seed)
    omega = [np.zeros(round(rest_s * RATE))]
    marks = np.radians(hand_deg) * rng.standard_normal(len(turns) + 1)
    for n, error in zip(turns, np.diff(marks), strict=True):
        t = np.linspace(0.0, 1.0, round(RATE * rng.uniform(2.5, 4.0) * max(abs(n), 0.5)))
        wish = np.sin(np.pi * t) * (1.2 + np.sin(7.0 * np.pi * t + rng.uniform(0, 6)))
        turn = wish * (2 * np.pi * n + error) / (wish.sum() / RATE)
        parts = np.split(turn, [len(turn) // 3]) if pause else [turn]
        pieces = [np.zeros(round(rest_s * RATE))]
        omega += [x for part in parts for x in (part, *pieces)]
    omega = np.concatenate(omega)
    drift = np.cumsum(rng.standard_normal(len(omega))) * 2e-5
    gyro = scale * omega + BIAS + drift + noise * rng.standard_normal(len(omega))
    z = np.column_stack([np.full((len(omega), 2), np.nan), gyro])
    t_ns = np.arange(len(omega), dtype=np.int64) * (10**9 // RATE)
    return Run("turned", None, t_ns, np.zeros((len(omega), 3)), sensors={"imu": Channel(t_ns, t_ns, z)})


@pytest.fixture(scope="module")
def small():
    return load("small")


def test_the_true_gyro_scale_lies_within_a_narrow_interval(small):
    count, widths, usable = 0, [], 0
    for seed in range(200):
        calibration = calibrate_by_hand_turns(by_hand_log((2, -2) if seed % 2 else (2, 2, -2), seed), small)
        row = calibration.rows()[0]
        count += row["low"] < SCALE < row["high"]
        assert row["name"] == NAME
        widths.append(row["high"] - row["low"])
        usable += calibration.verdict == "USABLE"
    assert 180 <= count <= 198
    assert np.median(widths) < 0.018
    assert usable >= 190, "a hand may seem careless once in a hundred times"


def test_the_gyro_bias_is_measured_in_the_rests(small):
    row = calibrate_by_hand_turns(by_hand_log(), small).rows()[1]
    assert row["name"] == "sensors.imu.gyro_bias"
    assert row["value"] == pytest.approx(BIAS, abs=0.002)
    assert "at rest, 3 times" in row["text"]


def test_a_pause_within_a_turn_is_not_a_rest_on_the_mark(small):
    calibration = calibrate_by_hand_turns(by_hand_log((2,), pause=True), small)
    assert calibration.value(NAME) == pytest.approx(SCALE, abs=0.012)
    assert "2 turns by hand, between 2 rests on a mark" in " ".join(calibration.table().split())


def test_a_larger_placement_error_widens_the_interval(small):
    careful, careless = (
        calibrate_by_hand_turns(by_hand_log((2, -2, 2, -2, 2, -2), 4, hand_deg), small).rows()[0]
        for hand_deg in (1.0, 5.0)
    )
    assert careless["high"] - careless["low"] > 1.5 * (careful["high"] - careful["low"])
    assert careless["low"] < SCALE < careless["high"]


def test_half_a_turn_is_refused(small):
    with pytest.raises(UsageError, check=of_code("turns.not-whole")):
        calibrate_by_hand_turns(by_hand_log((1.5,)), small)


def test_an_ambiguous_number_of_turns_must_be_given_by_the_user(small):
    run = by_hand_log((12,))
    with pytest.raises(UsageError, check=of_code("turns.ambiguous")):
        calibrate_by_hand_turns(run, small)
    assert calibrate_by_hand_turns(run, small, 12).value(NAME) == pytest.approx(SCALE, abs=0.003)


def test_a_run_without_a_turn_is_refused_with_a_remedy(small):
    with pytest.raises(UsageError, check=of_code("turns.few-rests", rests=1)):
        calibrate_by_hand_turns(by_hand_log(()), small)


def test_a_gap_or_a_saturated_gyro_is_refused(small):
    run = by_hand_log()
    t_ns, _, z = run.sensors["imu"]
    is_present = (t_ns < 5_000_000_000) | (t_ns > 5_400_000_000)
    silent = Channel(t_ns[is_present], t_ns[is_present], z[is_present])
    with pytest.raises(UsageError, check=of_code("turns.silent")):
        calibrate_by_hand_turns(replace(run, sensors={"imu": silent}), small)
    z = z.copy()
    z[500, 2] = 17.46
    with pytest.raises(UsageError, check=of_code("turns.end-of-range")):
        calibrate_by_hand_turns(replace(run, sensors={"imu": Channel(t_ns, t_ns, z)}), small)


def test_a_noise_free_gyro_is_accepted(small):
    assert calibrate_by_hand_turns(by_hand_log(noise=0.0), small).value(NAME) == pytest.approx(
        SCALE, abs=0.012
    )


def test_a_run_with_commands_is_not_classified_as_turned_by_hand():
    run = by_hand_log()
    assert is_turned_by_hand(run)
    assert not is_turned_by_hand(replace(run, applied_commands=0.3 + run.applied_commands))


def test_a_fit_of_a_run_turned_by_hand_is_refused(small):
    with pytest.raises(UsageError, check=of_code("runs.all-still")):
        identify(by_hand_log(), small, [NAME], use=("imu[2]",), options=FitOptions(measured=["end: 720 deg"]))


def test_the_command_line_writes_the_scale_into_the_vehicle_file(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    small.save(tmp_path / "vehicle.toml")
    write_run(by_hand_log(), tmp_path / "turned.mcap")
    with pytest.raises(SystemExit) as exit_info:
        main(["runs", "calibrate", "turned.mcap", "--update", "--json"])
    assert exit_info.value.code == 0
    reply = json.loads(capsys.readouterr().out)
    assert reply["verdict"] == "USABLE"
    file = load(tmp_path / "vehicle.toml")
    assert file.sensors.imu.gyro_scale == pytest.approx(reply["rows"][0]["value"], rel=1e-4)
    assert file.provenance[NAME].std == pytest.approx(reply["rows"][0]["std"], rel=1e-2)


def test_two_turns_on_the_mark_shrink_the_corridor_of_a_route(small):
    calibration = calibrate_by_hand_turns(by_hand_log((2, -2)), small)
    after = calibration.updated_file(small)
    assert after.value(f"{NAME}_std") == pytest.approx(
        calibration.numbers[0].std / calibration.numbers[0].value
    )
    assert "gyro_bias_std" not in after.text  # a rest today does not predict the next bias
    route = circle(0.6, 0.2)
    large, narrow = (forecast_corridor(file, route, 3).rows()[-1] for file in (small, after))
    assert narrow["heading_rad"] < 0.6 * large["heading_rad"]


@pytest.mark.parametrize("upward", [1, -1])
def test_turns_by_hand_with_an_imu_whose_z_points_down_give_a_warning(small, tmp_path, upward):
    """Turns on a mark do not show their direction: a gyro of the wrong sign has an equally good scale."""
    log = by_hand_log()
    gyro = log.sensors["imu"].z[:, 2]
    noise = 0.05 * np.random.default_rng(0).standard_normal((len(log.t_ns), 3))
    table = np.column_stack([log.t_s, noise + np.array([0.0, 0.0, 9.8 * upward]), upward * gyro])
    lines = [",".join(f"{x:.6f}" for x in row) for row in table]
    (tmp_path / "log.csv").write_text(
        "\n".join(["t_s,ax_mps2,ay_mps2,az_mps2,gz_rads", *lines]), encoding="utf-8"
    )
    z = ", ".join(
        f'{{ column = "{c}", unit = "{u}" }}'
        for c, u in (("ax_mps2", "m/s^2"), ("ay_mps2", "m/s^2"), ("gz_rads", "rad/s"))
    )
    column_map = (
        f'format = 1\nname = "log"\n[files.log]\ntime = "t_s"\ntime_unit = "s"\n[sensors.imu]\nz = [{z}]\n'
    )
    (tmp_path / "log.toml").write_text(column_map, encoding="utf-8")
    run = import_run(tmp_path / "log.toml", tmp_path / "log.csv").run
    calibration = calibrate_by_hand_turns(run, small)
    assert calibration.value(NAME) == pytest.approx(SCALE, rel=0.01)
    assert calibration.verdict == ("USABLE" if upward > 0 else "WARN")
    assert any(includes(reason, "recording.not-level") for reason in calibration.reasons) == (upward < 0)
