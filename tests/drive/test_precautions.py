"""Precautions of a repetition: an impossible route is refused, the vehicle joins its route, slows down and stops."""

from types import SimpleNamespace

import numpy as np
import pytest

from baqueano.diagnostics import StopReason
from baqueano.drive import drive_stop_reason, repeat, tasks
from baqueano.drive.mission import Mission, perform
from baqueano.drive.safety.caution import REST_S, SLOW, WAIT_S, Caution
from baqueano.drive.safety.patience import Patience, TimeLimit
from baqueano.drive.safety.precautions import Precautions, approach_limits
from baqueano.drive.safety.room_watch import RoomWatch, stopping_distance
from baqueano.drive.tasks import drive_with_driver
from baqueano.errors import AnswerNo, UsageError
from baqueano.estimators.covariance import CHI_SQUARE_95
from baqueano.guides import Idle, Repeat
from baqueano.guides.shapes import circle, line
from baqueano.loop import Blocks, Record
from baqueano.messages.notation import current_notation
from baqueano.monitor.findings import AWAY, MODEL, SENSOR, UNKNOWN, Finding
from baqueano.routes import examine
from baqueano.routes.room import Room, vehicle_room
from baqueano.signals import NANOSECONDS, Command, Estimate, Reference, Tick, empty_slots
from baqueano.vehicle_file import load, parse
from baqueano.worlds import SimulatedWorld
from tests.codes import refused
from tests.drive.straight import as_fitted

SMALL, LAP = load("small"), circle(0.4, 0.25)
BESIDE = np.array([0.0, 0.2, np.radians(30.0)])


def off_route(run, route):
    """Return the distance of each true position from the route, and the distance travelled until then [m]."""
    xy = run.truth.eta[::5, :2]
    distance = np.array([np.min(np.hypot(*(route.eta[:, :2] - p).T)) for p in xy])
    return distance, np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))


def record(t_s, eta=(0.0, 0.0, 0.0), nu=(0.0, 0.0, 0.0), cov=None, velocity=(0.0, 0.0, 0.0), degraded=()):
    """Return the record of one tick of a drive."""
    t_ns, zero = round(1e9 * t_s), np.zeros(3)
    cov = np.zeros((6, 6)) if cov is None else cov
    return Record(
        Tick(t_ns, zero, empty_slots({})), Command(t_ns, zero), Command(t_ns, zero),
        Estimate(t_ns, np.array(eta), np.array(nu), cov), Reference(t_ns, np.array(velocity), zero, 0.0), degraded,
    )  # fmt: skip


def test_an_impossible_route_is_refused_by_repeat_and_by_a_mission():
    fast, fitted_file = circle(1.0, 10.0), as_fitted(SMALL)
    for drive in (repeat, lambda file, route: perform(Mission("repeat", route=route), file)):
        with refused("route.speed-too-high", AnswerNo):
            drive(SMALL, fast)
        with refused("route.speed-too-high", AnswerNo):
            drive(fitted_file, fast)


@pytest.mark.parametrize(
    ("room", "code"), [(2, "room.kind"), ((2.0, 2.0), "room.kind"), ("2", "room.unreadable")]
)
def test_a_room_without_width_and_height_as_text_is_a_usage_error(room, code):
    for call in (lambda: repeat(SMALL, LAP, room=room), lambda: examine(LAP, SMALL, room)):
        with refused(code, UsageError) as error:
            call()
        assert current_notation().command(error.value.diagnostic.fix) == 'room="2x2"'


def test_a_room_as_text_is_the_room_of_the_vehicle():
    with refused("route.through-wall", AnswerNo):
        repeat(SMALL, LAP, room="0.3x0.3")
    room = vehicle_room(SMALL, "2x3")
    assert (room.radius_m, vehicle_room(None, "2x3").radius_m) == (0.07, 0.0)
    assert examine(LAP, SMALL, "2x3").clearance_m == examine(LAP, SMALL, room).clearance_m


def test_the_force_option_permits_high_speed_but_not_nan():
    run = repeat(SMALL, circle(1.0, 2.0), force=True, duration_s=0.1)
    assert len(run.t_ns) > 5
    rows = LAP.nu.copy()
    rows[7] = np.nan
    with refused("route.no-number", AnswerNo):
        repeat(SMALL, LAP._replace(nu=rows), force=True)


def test_a_route_that_a_guessed_model_can_hardly_drive_is_a_warning_of_the_run():
    guess = as_fitted(SMALL)
    run = repeat(guess, circle(1.0, 2.0), force=True, duration_s=0.1)
    (event,) = [event for event in run.events if event.source == "drive" and event.level == "warning"]
    assert event.diagnostic.code == "route.speed-too-high"


def test_a_vehicle_beside_its_route_joins_the_route_by_a_lead_in():
    run = repeat(SMALL, LAP, eta=BESIDE)
    distance, path_m = off_route(run, LAP)
    assert np.max(distance[path_m > 0.6]) < 0.01  # it joins the route some 0.4 m ahead
    assert run.reference.eta[0] == pytest.approx(BESIDE, abs=1e-3)
    assert run.duration_s < run.rest_s + LAP.t_s[-1] + 1.5  # no part of the route is driven twice
    assert run.reference.at_end[-1] == 1.0


def test_without_a_lead_in_the_guide_of_the_file_is_used():
    guide = SMALL.guide(LAP)
    for care, eta in ((Precautions(), LAP.eta[0]), (Precautions(lead_in=False), BESIDE)):
        assert care.wrap_guide(guide, LAP, SMALL, eta, SMALL.estimator()) is guide


@pytest.mark.parametrize("name", ["small", "car"])
def test_the_lead_in_radius_is_possible_for_the_vehicle(name):
    from baqueano.routes.capability import Capability

    file, route = load(name), circle(2.0, 0.4)
    limits = approach_limits(route, file)
    assert limits["speed_m_s"] == pytest.approx(0.4)
    assert Capability(file).share(0.4, 0.4 / limits["radius_m"]) < 1.0


def test_the_lead_in_ramp_is_the_time_of_a_slow_servo_at_full_lock():
    """κ rises to its largest value / 1.3 along 1 − exp(−t/λ). Before, the ramp was λ / 0.3."""
    lag_s = 0.2
    limits = approach_limits(circle(3.0, 1.0), load("car").with_values({"model.yaw_lag_s": lag_s}))
    assert limits["ramp_m"] == pytest.approx(lag_s * np.log(1.3 / 0.3), rel=0.05)


def test_a_vehicle_returns_to_its_route_after_a_push():
    run = repeat(SMALL, LAP, shake=["3 s: push 0.5 N s left"])
    distance, _ = off_route(run, LAP)
    after = run.truth.t_ns[::5] > 6e9
    assert np.max(distance[~after]) > np.max(distance[after])
    assert np.max(distance[after]) < 0.03
    assert drive_stop_reason(run) is None


def doubtful(error):
    return (Finding("imu[2]", 0, 3.0, AWAY, error, 1.0, 0.0, 1.0),)


def watch_rows(caution, rows):
    """Return pace and stop after each (time, finding)."""
    out = []
    for t_s, degraded_sensors in rows:
        reason = caution.stop_reason(round(1e9 * t_s))
        caution.on_record(record(t_s, degraded=degraded_sensors))
        out.append((caution._guide.pace, reason))
    return out


def begin(*arguments):
    caution = Caution(*arguments)
    caution.begin(Blocks(None, Idle(9.0), None, None))
    return caution


def test_an_inconsistent_sensor_slows_and_stops_the_vehicle():
    times = np.arange(0.0, WAIT_S + REST_S + 0.2, 0.1)
    caution = begin()
    rows = watch_rows(caution, [(t, doubtful(SENSOR)) for t in times])
    paces = [pace for pace, _ in rows]
    assert paces[:29] == [SLOW] * 29
    assert paces[31:] == [0.0] * len(paces[31:])
    (code,) = {reason.code for _, reason in rows if reason is not None}
    assert code == StopReason.ESTIMATE_DOUBTFUL
    assert rows[38][1] is None
    assert rows[-1][1].figures["cause"].subject == "imu[2]"
    assert [(level, event.code) for _, level, event in caution.events()] == [("warning", "caution.slow")]


def test_only_a_misfit_of_unknown_cause_slows_the_vehicle():
    for error, pace in ((UNKNOWN, SLOW), (MODEL, 1.0)):
        rows = watch_rows(begin(), [(t, doubtful(error)) for t in np.arange(0.0, 9.0, 0.5)])
        assert rows == [(pace, None)] * 18


def test_the_speed_recovers_after_a_misfit_ends():
    caution = begin()
    rows = watch_rows(
        caution, [(0.0, doubtful(SENSOR)), (2.0, ()), (3.0, doubtful(SENSOR)), (5.5, doubtful(SENSOR))]
    )
    assert [pace for pace, _ in rows] == [SLOW, 1.0, SLOW, SLOW]
    assert [event.code for _, _, event in caution.events()] == [
        "caution.slow",
        "caution.over",
        "caution.slow",
    ]


def test_an_uncertain_position_slows_the_vehicle():
    caution, cov = begin(0.5), np.diag([0.4**2, 0.0, 0.0, 0.0, 0.0, 0.0])
    for t_s in (0.0, WAIT_S):
        caution.on_record(record(t_s, cov=cov))
    assert caution._guide.pace == 0.0
    assert caution.stop_reason(round(1e9 * (WAIT_S + REST_S))).figures["cause"].code == "caution.uncertain"


def test_without_caution_the_vehicle_does_not_slow():
    assert watch_rows(begin(0.5, False), [(t, doubtful(SENSOR)) for t in (0.0, 9.0)]) == [(1.0, None)] * 2


def test_a_drive_with_sensor_spikes_slows_and_logs_the_reason():
    run = repeat(SMALL, LAP, laps=2, shake=["3-60 s: spikes imu[0] 8, 50 %"])
    slow = [event for event in run.events if event.source == "caution"]
    assert slow[0].diagnostic.code == "caution.slow"
    is_later = run.t_ns > slow[0].t_ns + 1_000_000_000
    assert np.max(run.reference.nu[is_later, 0]) == pytest.approx(SLOW * 0.25)


def test_a_stuck_vehicle_ends_the_drive_and_a_waiting_vehicle_does_not():
    at_wall, waits, goes, pauses = watches = [Patience(5.0) for _ in range(4)]
    for watch in watches:
        watch.begin(SimpleNamespace(guide=SimpleNamespace(pace=float(watch is not pauses))))
    for t_s in np.arange(0.0, 8.0, 0.1):
        at_wall.on_record(record(t_s, velocity=(0.2, 0.0, 0.0)))
        waits.on_record(record(t_s, velocity=(0.02, 0.0, 0.0)))
        goes.on_record(record(t_s, eta=(0.1 * t_s, 0.0, 0.0), velocity=(9.0, 0.0, 0.0)))
        pauses.on_record(record(t_s, velocity=(0.2, 0.0, 0.0)))
    assert at_wall.stop_reason(4_900_000_000) is None
    assert at_wall.stop_reason(5_100_000_000).code == StopReason.STUCK
    assert waits.stop_reason(7_950_000_000) is None
    assert goes.stop_reason(7_950_000_000) is None
    assert pauses.stop_reason(7_950_000_000) is None  # a person moved it aside


class EndlessGuide:
    """A guide that forgets to end the drive."""

    def init(self):
        return None

    def step(self, state, estimate):
        return state, Reference(estimate.t_ns, estimate.eta, np.zeros(3), 0.0)


def test_a_guide_without_an_end_is_stopped_after_a_multiple_of_the_planned_time():
    short = line(0.5, 0.5)
    run = repeat(SMALL, short, guide=EndlessGuide, rest_s=0.0)
    planned_s = Repeat.along(short, 1).duration_s
    reason = drive_stop_reason(run)
    assert (reason.code, reason.figures["limit_s"]) == (StopReason.TIME_LIMIT, 10.0 * planned_s + 60.0)
    assert reason.figures["limit_s"] <= run.duration_s < reason.figures["limit_s"] + 2.0


def test_the_time_limit_of_a_drive_can_be_set_and_does_not_count_pauses():
    run = repeat(SMALL, LAP, guide=EndlessGuide, time_limit_s=3.0, rest_s=0.0)
    assert 3.0 <= run.duration_s < 5.0
    limit, guide = TimeLimit(3.0), SimpleNamespace(pace=0.0)
    limit.begin(SimpleNamespace(guide=guide))
    for t_s in np.arange(0.0, 5.0, 0.1):
        guide.pace = float(t_s > 4.0)
        assert limit.stop_reason(round(t_s * NANOSECONDS)) is None
    assert drive_stop_reason(repeat(SMALL, LAP, time_limit_s=1.0)).code == StopReason.TIME_LIMIT


def test_a_lesson_by_a_guide_without_an_end_is_stopped(monkeypatch):
    monkeypatch.setattr(tasks, "LESSON_LIMIT_S", 2.0)
    assert drive_stop_reason(drive_with_driver(SMALL, EndlessGuide)).code == StopReason.TIME_LIMIT


def test_position_uncertainty_stops_the_vehicle_before_the_wall():
    room, origin = Room(2.0, 4.0, start=(0.5, 0.0, np.pi / 2)), np.array([3.0, 0.0, 0.0])
    std = 0.1
    for y, stops in ((0.0, False), (1.5 - np.sqrt(CHI_SQUARE_95) * std + 0.01, True)):
        watch = RoomWatch(room, origin, lambda v: 0.3 * v)  # the map's y is the room's −x
        watch.on_record(record(0.0, eta=(3.0, y, 0.0), cov=np.diag([std**2] * 6)))
        assert (watch.stop_reason(0) is not None) == stops
    assert watch.stop_reason(0).figures["axis"] == "x"
    room_watch = RoomWatch(room, origin, lambda v: 0.3 * v)
    room_watch.on_record(record(0.0, eta=(3.0, 1.4, np.pi / 2), nu=(0.5, 0.0, 0.0)))
    assert room_watch.stop_reason(0).figures["stop_m"] == pytest.approx(0.15)


@pytest.mark.parametrize("speed_m_s", [0.5, 2.0])
def test_a_car_that_coasts_is_stopped_before_the_wall(speed_m_s):
    """The car of the garage coasts 0.9 m from 2 m/s; 0.3 s times its speed are 0.6 m."""
    car, wall_m, x = load("car"), 5.0, 3.0
    stopping_m = stopping_distance(car.vehicle, 2.0)
    while True:
        watch = RoomWatch(Room(2.0 * wall_m, 18.0), np.zeros(3), stopping_m)
        watch.on_record(record(0.0, eta=(x, 0.0, 0.0), nu=(speed_m_s, 0.0, 0.0), cov=np.zeros((6, 6))))
        if watch.stop_reason(0) is not None:
            break
        x += 0.01
    state = car.vehicle.init(np.array([x, 0.0, 0.0]), np.array([speed_m_s, 0.0, 0.0]))
    for _ in range(200):
        state, _ = car.vehicle.step(state, np.zeros(2), 0.02, np.zeros(3))
    assert wall_m - 0.25 * speed_m_s < state.eta[0] < wall_m


@pytest.mark.parametrize("weak_sign", [1.0, -1.0])
def test_the_stopping_distance_is_that_of_the_direction_with_less_friction(weak_sign):
    """The vehicle is without a drivetrain. In one direction it decelerates with 0.5 m/s², in the other with 2.0."""

    def nu_dot(nu, effort, psi):
        return np.array([-np.sign(nu[0]) * (0.5 if nu[0] * weak_sign > 0.0 else 2.0), 0.0, 0.0])

    vehicle = SimpleNamespace(commands=1, nu_dot=nu_dot)
    assert stopping_distance(vehicle, 1.0)(1.0) == pytest.approx(1.0, rel=0.01)  # v²/2a


def test_endless_laps_by_imu_stop_before_a_wall():
    room = vehicle_room(SMALL, "2x2", start=(0.0, -0.4, 0.0))
    run = repeat(SMALL, LAP, laps=0, room=room, duration_s=120.0)
    assert drive_stop_reason(run).code == StopReason.ROOM
    assert np.all(np.abs(run.truth.eta[:, :2] + [0.0, -0.4]) < room.free_half_width_m)


def test_a_mission_contains_its_precautions_and_the_start_pose():
    care = Precautions(
        room=Room(2.0, 4.0, start=(0.0, 0.5, 0.1)), lead_in=False, patience_s=7.0, time_limit_s=9.0
    )
    mission = Mission("repeat", route=LAP, start=(0.0, 0.2, 0.5), precautions=care.to_json())
    mission_received = Mission.from_json(mission.to_json())
    assert mission_received.start == (0.0, 0.2, 0.5)
    assert Precautions.from_json(mission_received.precautions) == Precautions.from_json(mission.precautions)
    assert "precautions" not in Mission("repeat", route=LAP).to_json()  # as older robots expect


@pytest.mark.parametrize(
    "names",
    [
        {"force": 1},
        {"time_limit_s": "long"},
        {"nothing": True},
        {"room": {"free": [1.0]}},
        {"patience_s": "long"},
    ],
)
def test_unknown_precautions_are_refused(names):
    with refused("mission.damaged", UsageError):
        Mission("repeat", route=LAP, precautions=names)


def test_the_return_path_ends_at_the_start():
    run = repeat(SMALL, line(0.8, 0.25), way_back=True)
    assert run.reference.eta[-1] == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.hypot(*run.truth.eta[-1, :2]) < 0.05


@pytest.mark.parametrize(("name", "route"), [("small", line(1.5, 0.2)), ("car", line(6.0, 0.8))])
def test_the_way_back_has_no_jump_and_ends_at_rest(name, route):
    file = load(name)
    run = repeat(file, route, way_back=True)
    nu, limits = run.reference.nu, approach_limits(route, file)
    largest_rate = limits["speed_m_s"] / limits["radius_m"]
    assert np.max(np.abs(np.diff(nu[:, 2]))) < 0.25 * largest_rate
    assert abs(run.truth.nu[-1, 0]) < 0.03  # it was 0.056 m/s and 0.33 rad/s
    assert abs(run.truth.nu[-1, 2]) < 0.1
    assert drive_stop_reason(run) is None


CAMERA = '[sensors.pose]\nkind = "pose"\nnoise_std = [0.003, 0.003, 0.006]\n\n[estimator]'
WITH_CAMERA = parse(load("car").text.replace("[estimator]", CAMERA), "car").with_values(
    {"estimator.use": ["imu", "odometer", "pose"]}
)


@pytest.mark.parametrize(("shake", "codes"), [([], []), (["10.8 s: push 2 N s left"], ["drive.end-beside"])])
def test_a_drive_reports_that_it_ended_beside_the_end_of_its_route(shake, codes):
    """Before, a vehicle that was pushed on its last metre stood 6 to 14 cm beside the end without a sentence."""
    file = parse(SMALL.text.replace("[estimator]", CAMERA), "seen").with_values(
        {"estimator.use": ["imu", "pose"]}
    )
    run = repeat(file, circle(0.3, 0.2), controller="pure_pursuit", shake=shake)
    warnings = [event.diagnostic for event in run.events if event.level == "warning"]
    warnings = [diagnostic for diagnostic in warnings if diagnostic.code.startswith("drive.")]
    assert [diagnostic.code for diagnostic in warnings] == codes
    distance_m = np.hypot(*(run.reference.eta[-1] - run.truth.eta[-1])[:2])
    assert (distance_m > 0.05) == bool(codes)
    for diagnostic in warnings:
        assert diagnostic.figures["distance_cm"] == pytest.approx(100.0 * distance_m, abs=1.0)


@pytest.mark.parametrize("sensor", ["odometer", "pose"])
def test_a_vehicle_that_loses_a_sensor_slows_down_and_stops_and_names_it(sensor):
    lap = circle(0.8, 0.5)
    run = repeat(WITH_CAMERA, lap, laps=3, duration_s=20.0, shake=[f"10 s: cut {sensor}"])
    reason = drive_stop_reason(run)
    assert reason.code == StopReason.ESTIMATE_DOUBTFUL
    cause = reason.figures["cause"].figures["cause"]
    assert (cause.code, cause.subject) == ("sensor.lost", sensor)
    is_late = run.truth.t_ns * 1e-9 > 16.5
    assert np.max(np.abs(run.truth.nu[is_late, 0])) < 0.03
    assert np.max(off_route(run, lap)[0]) < 0.05


def test_a_camera_that_sees_the_vehicle_only_at_a_gate_does_not_stop_it():
    class Gate(SimulatedWorld):
        def read(self, t_ns):
            unseen = empty_slots({"pose": 3}).pose
            is_seen = np.hypot(*self.truth.eta[:2]) < 0.5
            ticks = super().read(t_ns)
            return [t if is_seen else t._replace(sensors=t.sensors._replace(pose=unseen)) for t in ticks]

    gate = Gate(WITH_CAMERA.vehicle, WITH_CAMERA.sensors, WITH_CAMERA.rate_hz)
    run = repeat(WITH_CAMERA, circle(0.8, 0.5), laps=2, world=gate)
    assert drive_stop_reason(run) is None
    assert [event for event in run.events if event.source in ("caution", "sensors")] == []
