"""Reads a recording with the official MCAP reader and its ROS 2 decoder, and prints what it found as one JSON object.

Everything comes from the file: types, definitions, messages. Nothing here knows our code.
"""

import json
import math
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def stamp(message):
    header = getattr(message, "header", None)
    if header is None and getattr(message, "transforms", None):
        header = message.transforms[0].header
    return header.stamp.sec + header.stamp.nanosec * 1e-9


def look(topic, message):
    """What a person would check of one message of each kind."""
    kind = type(message).__name__
    if kind == "Image":
        bytes_per_pixel = {"rgb8": 3, "16UC1": 2}[message.encoding]
        assert message.step == message.width * bytes_per_pixel, topic
        assert len(message.data) == message.step * message.height, topic
    elif kind == "CompressedImage":
        start = bytes(message.data[:4])
        assert start[:2] == b"\xff\xd8" if "jpeg" in message.format else start == b"\x89PNG", topic
    elif kind == "PointCloud2":
        assert len(message.data) == message.point_step * message.width * message.height, topic
        assert [field.name for field in message.fields][:3] == ["x", "y", "z"], topic
    elif kind == "Imu":
        force = message.linear_acceleration
        assert 5 < math.hypot(force.x, force.y, force.z) < 15, topic
        assert message.orientation_covariance[0] == -1, topic
    elif kind == "NavSatFix" and message.status.status >= 0:
        assert abs(message.latitude - 50.7277) < 0.01 and abs(message.longitude - 7.0866) < 0.01, topic
    elif kind == "Odometry":
        q = message.pose.pose.orientation
        assert abs(math.hypot(q.x, q.y, q.z, q.w) - 1) < 1e-9, topic
    elif kind == "CameraInfo":
        assert message.k[0] > 0 and len(message.d) == 5, topic
    elif kind == "Mavlink":
        assert message.magic == 0xFD and len(message.payload64) == (message.len + 7) // 8, topic
    elif kind == "JointState":
        assert len(message.name) == len(message.position) == 2, topic


def main(path):
    counts, types, last = {}, {}, 0
    frames = set()
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        indexed = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
        for schema, channel, record, message in reader.iter_decoded_messages(log_time_order=False):
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr"), channel.topic
            assert record.log_time >= last, f"{channel.topic} is out of order"
            last = record.log_time
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            types[channel.topic] = schema.name
            assert abs(stamp(message) - record.publish_time * 1e-9) < 1e-6, channel.topic
            for transform in getattr(message, "transforms", []):
                frames |= {transform.header.frame_id, transform.child_frame_id}
            look(channel.topic, message)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert counts == indexed, "the index counts what is there"
    print(json.dumps({"counts": counts, "types": types, "frames": sorted(frames), "metadata": metadata}))


main(sys.argv[1])
