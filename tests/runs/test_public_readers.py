"""Public readers can open the files of baqueano: mcap, mcap-ros2-support, rosbags."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from baqueano.runs import write_run
from baqueano.runs.container.messages import SCHEMAS

TOPICS = {
    "/command/applied": ("baqueano_msgs/msg/Command", 200),
    "/command/requested": ("baqueano_msgs/msg/Command", 200),
    "/command/sent": ("baqueano_msgs/msg/Command", 200),
    "/sensors/imu": ("sensor_msgs/msg/Imu", 200),
    "/sensors/odometer": ("baqueano_msgs/msg/Measurement", 40),
    "/estimate": ("baqueano_msgs/msg/Estimate", 200),
    "/estimate/pose": ("geometry_msgs/msg/PoseStamped", 200),
    "/reference": ("baqueano_msgs/msg/Reference", 200),
    "/reference/pose": ("geometry_msgs/msg/PoseStamped", 200),
    "/truth": ("baqueano_msgs/msg/Motion", 200),
    "/truth/pose": ("geometry_msgs/msg/PoseStamped", 200),
    "/events": ("rcl_interfaces/msg/Log", 1),
}


@pytest.fixture
def path(run, tmp_path):
    return write_run(run, tmp_path / "0001-test.mcap")


def row_messages(path, topics=None):
    """Return (topic, time of arrival, message) as mcap-ros2-support decodes them."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages(topics=topics):
            yield channel.topic, message.log_time, content


def check(run, topic, messages):
    """Compare `messages`, (time of arrival, message) of one topic, with the run."""
    assert len(messages) == TOPICS[topic][1]
    k = len(messages) // 2
    arrival, m = messages[k]
    if topic.startswith("/command/"):
        assert list(m.u) == getattr(run, f"{topic.rsplit('/', 1)[1]}_commands")[k].tolist()
    elif topic == "/sensors/imu":
        z = run.sensors["imu"].z[k]
        a, w = m.linear_acceleration, m.angular_velocity
        assert [a.x, a.y, w.z] == z.tolist()
        assert m.orientation_covariance[0] == -1.0  # REP 145: unknown
        assert m.header.frame_id == "imu"
        assert m.header.stamp.sec * 10**9 + m.header.stamp.nanosec == run.sensors["imu"].t_ns[k]
        assert arrival == run.sensors["imu"].arrival_ns[k]
    elif topic == "/sensors/odometer":
        assert list(m.z) == run.sensors["odometer"].z[k].tolist()
    elif topic == "/estimate":
        assert list(m.cov) == run.estimate.cov[k].ravel().tolist()
        assert np.array_equal(m.innovation, run.estimate.innovation[k], equal_nan=True)
        assert list(m.innovation_cov) == run.estimate.innovation_cov[k].ravel().tolist()
    elif topic == "/reference":
        assert list(m.nu) == run.reference.nu[k].tolist()
    elif topic == "/truth":
        assert list(m.nu) == run.truth.nu[k].tolist()
        assert all(map(math.isnan, m.nu_dot))
    elif topic == "/events":
        assert (m.level, m.name, m.msg) == (30, "supervisor", "1.2 m/s > 1.0 m/s, ñandú")
    else:
        log = getattr(run, topic.split("/")[1])
        p, q = m.pose.position, m.pose.orientation
        assert [p.x, p.y] == log.eta[k, :2].tolist()
        assert 2 * math.atan2(q.z, q.w) == pytest.approx(
            math.remainder(log.eta[k, 2], 2 * math.tau), abs=1e-12
        )


def test_the_mcap_reader_lists_every_topic_and_the_vehicle_file(run, path):
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
        kinds = {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}
        counts = {summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()}
        assert {topic: (schema.name, counts[topic]) for topic, schema in kinds.items()} == TOPICS
        assert {schema.encoding for schema in kinds.values()} == {"ros2msg"}
        assert [a.data.decode() for a in reader.iter_attachments()] == [run.vehicle_text]
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata["seed"] == "7"


def test_mcap_ros2_support_decodes_every_message(run, path):
    messages_by_topic = {}
    for topic, t_ns, message in row_messages(path):
        messages_by_topic.setdefault(topic, []).append((t_ns, message))
    assert set(messages_by_topic) == set(TOPICS)
    for topic, messages in messages_by_topic.items():
        check(run, topic, messages)


def test_rosbags_decodes_every_message(run, path):
    messages_by_topic = {}
    with AnyReader([path]) as reader:
        for connection, t_ns, raw in reader.messages():
            assert connection.msgtype == TOPICS[connection.topic][0]
            messages_by_topic.setdefault(connection.topic, []).append(
                (t_ns, reader.deserialize(raw, connection.msgtype))
            )
    assert set(messages_by_topic) == set(TOPICS)
    for topic, messages in messages_by_topic.items():
        check(run, topic, messages)


def test_an_estimate_without_innovation_is_decoded(run, tmp_path):
    variant = replace(run, estimate=run.estimate._replace(innovation=None, innovation_cov=None))
    path = write_run(variant, tmp_path / "x.mcap")
    _, _, first = next(row_messages(path, ["/estimate"]))
    assert (first.innovation_size, list(first.innovation), list(first.innovation_cov)) == (0, [], [])
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic == "/estimate"]
        connection, _, raw = next(reader.messages(connections=connections))
        assert len(reader.deserialize(raw, connection.msgtype).innovation_cov) == 0


def test_every_message_definition_is_self_contained():
    for name, text in SCHEMAS.items():
        parts = text.split("=" * 80)
        definitions = {part.splitlines()[1].removeprefix("MSG: ") for part in parts[1:]}
        names_used = {
            line.split()[0]
            for part in parts
            for line in part.splitlines()
            if "/" in line.split("#")[0][:40] and "MSG:" not in line
        }
        assert names_used <= definitions, name
