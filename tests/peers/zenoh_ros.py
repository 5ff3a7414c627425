"""Talks ROS 2 over Zenoh as nodes with rmw_zenoh do, with Zenoh's Python API and CDR of its own.

usage: zenoh_ros.py listen ENDPOINT FRAMES
       zenoh_ros.py drive ENDPOINT FRAMES

ENDPOINT is where a router is, such as tcp/127.0.0.1:7447. `listen` waits until it has so many colour and depth images, and
prints one JSON object: the publishers of the ROS 2 graph, the camera, and of each image its stamp, size, encoding and
SHA-256. `drive` publishes a camera and so many frames as soon as somebody has subscribed to all, and prints the SHA-256 of
each image's pixels.
Exits 0 if it worked, 1 with the reason otherwise.
"""

import hashlib
import json
import queue
import struct
import sys
import time

import zenoh

PATIENCE_S = 30.0
DOMAIN = 0
# As `ros2 topic info --verbose` of Jazzy prints them.
IMAGE = "sensor_msgs::msg::dds_::Image_/RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
CAMERA_INFO = "sensor_msgs::msg::dds_::CameraInfo_/RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"
COLOR_TOPIC = "uav/camera/color/image_raw"
DEPTH_TOPIC = "uav/camera/depth/image_rect_raw"
INFO_TOPIC = "uav/camera/color/camera_info"

WIDTH, HEIGHT = 320, 240


class Failure(Exception):
    """What did not work."""


class Reader:
    """Reads little-endian CDR: each number at a multiple of its size after the four bytes of the header."""

    def __init__(self, message):
        if message[:2] != b"\x00\x01":
            raise Failure(f"no little-endian CDR: {message[:4].hex()}")
        self.body, self.at = message[4:], 0

    def numbers(self, kind, count=1):
        size = struct.calcsize(kind)
        self.at += -self.at % size
        values = struct.unpack_from(f"<{count}{kind}", self.body, self.at)
        self.at += size * count
        return values if count > 1 else values[0]

    def take(self, length):
        taken = self.body[self.at : self.at + length]
        if len(taken) != length:
            raise Failure(f"{length} bytes at {self.at} of {len(self.body)}")
        self.at += length
        return taken

    def text(self):
        text = self.take(self.numbers("I"))
        if not text.endswith(b"\x00"):
            raise Failure(f"string without its zero: {text}")
        return text[:-1].decode()

    def header(self):
        seconds, nanos = self.numbers("i"), self.numbers("I")
        return seconds * 10**9 + nanos, self.text()

    def end(self):
        if self.at != len(self.body):
            raise Failure(f"{len(self.body) - self.at} bytes left over")


class Writer:
    """The counterpart of Reader."""

    def __init__(self):
        self.body = bytearray()

    def numbers(self, kind, *values):
        self.body += bytes(-len(self.body) % struct.calcsize(kind))
        self.body += struct.pack(f"<{len(values)}{kind}", *values)

    def text(self, text):
        self.numbers("I", len(text) + 1)
        self.body += text.encode() + b"\x00"

    def header(self, nanos, frame):
        self.numbers("i", nanos // 10**9)
        self.numbers("I", nanos % 10**9)
        self.text(frame)

    def message(self):
        return b"\x00\x01\x00\x00" + bytes(self.body)


def read_image(message):
    reader = Reader(message)
    stamp, frame = reader.header()
    height, width = reader.numbers("I", 2)
    encoding = reader.text()
    bigendian = reader.numbers("B")
    step = reader.numbers("I")
    data = reader.take(reader.numbers("I"))
    reader.end()
    if bigendian or len(data) != step * height:
        raise Failure(f"{len(data)} bytes of {height} rows of {step}, big-endian {bigendian}")
    digest = hashlib.sha256(data).hexdigest()
    return {"stamp": stamp, "frame": frame, "size": [width, height], "encoding": encoding, "sha256": digest}


def read_camera(message):
    reader = Reader(message)
    stamp, frame = reader.header()
    height, width = reader.numbers("I", 2)
    model = reader.text()
    count = reader.numbers("I")
    coefficients = reader.numbers("d", count)
    k = reader.numbers("d", 9)
    reader.numbers("d", 9)
    reader.numbers("d", 12)
    reader.numbers("I", 6)
    reader.numbers("B")
    reader.end()
    return {"size": [width, height], "model": model, "d": list(coefficients), "k": list(k), "frame": frame}


def write_image(nanos, encoding, step, data):
    writer = Writer()
    writer.header(nanos, "camera")
    writer.numbers("I", HEIGHT, WIDTH)
    writer.text(encoding)
    writer.numbers("B", 0)
    writer.numbers("I", step)
    writer.numbers("I", len(data))
    writer.body += data
    return writer.message()


def write_camera(nanos):
    writer = Writer()
    writer.header(nanos, "camera")
    writer.numbers("I", HEIGHT, WIDTH)
    writer.text("plumb_bob")
    writer.numbers("I", 5)
    writer.numbers("d", 0.0, 0.0, 0.0, 0.0, 0.0)
    fx, cx, cy = 300.0, WIDTH / 2, HEIGHT / 2
    writer.numbers("d", fx, 0.0, cx, 0.0, fx, cy, 0.0, 0.0, 1.0)
    writer.numbers("d", 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    writer.numbers("d", fx, 0.0, cx, 0.0, 0.0, fx, cy, 0.0, 0.0, 0.0, 1.0, 0.0)
    writer.numbers("I", 0, 0, 0, 0, 0, 0)
    writer.numbers("B", 0)
    return writer.message()


def read_attachment(attachment):
    if attachment is None:
        raise Failure("a message without an attachment")
    data = attachment.to_bytes()
    sequence, stamp, length = struct.unpack_from("<qqB", data)
    if length != 16 or len(data) != 33:
        raise Failure(f"attachment is {data.hex()}")
    return {"sequence": sequence, "made": stamp, "gid": data[17:].hex()}


def connect(endpoint):
    config = zenoh.Config()
    for key, value in [
        ("mode", "peer"),
        ("connect/endpoints", [endpoint]),
        ("listen/endpoints", ["tcp/127.0.0.1:0"]),
        ("scouting/multicast/enabled", False),
    ]:
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def within(patience_s, attempt, what):
    """What `attempt` returns, as soon as that is something."""
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        found = attempt()
        if found:
            return found
        time.sleep(0.05)
    raise Failure(f"{what} within {patience_s:.0f} s")


def publishers(session):
    """Node, topic, type and hash of each publisher in the graph."""
    found = []
    for reply in session.liveliness().get(f"@ros2_lv/{DOMAIN}/**"):
        if reply.ok is not None:
            parts = str(reply.ok.key_expr).split("/")
            if parts[5] == "MP":
                found.append([parts[8], parts[9].replace("%", "/"), parts[10], parts[11], parts[12]])
    return sorted(found)


def listen(endpoint, frames):
    with connect(endpoint) as session:
        arrived = queue.Queue()
        topics = {"color": (COLOR_TOPIC, IMAGE), "depth": (DEPTH_TOPIC, IMAGE), "camera": (INFO_TOPIC, CAMERA_INFO)}
        subscribers = []
        for name, (topic, kind) in topics.items():
            into = lambda sample, name=name: arrived.put((name, sample))  # noqa: E731
            subscribers.append(session.declare_subscriber(f"{DOMAIN}/{topic}/{kind}", into))
        told = {"color": [], "depth": [], "camera": []}
        while len(told["color"]) < frames or len(told["depth"]) < frames or not told["camera"]:
            try:
                name, sample = arrived.get(timeout=PATIENCE_S)
            except queue.Empty:
                raise Failure(f"only {[len(told[n]) for n in told]} messages") from None
            message = sample.payload.to_bytes()
            content = read_camera(message) if name == "camera" else read_image(message)
            told[name].append(content | read_attachment(sample.attachment))
        told["publishers"] = publishers(session)
        print(json.dumps(told))


class Driver:
    """A camera's node."""

    def __init__(self, session):
        self.session = session
        self.held = [session.liveliness().declare_token(self.token(0, "NN", ""))]
        self.sent = {}
        self.publishers = {}
        for number, (topic, kind) in enumerate([(INFO_TOPIC, CAMERA_INFO), (COLOR_TOPIC, IMAGE), (DEPTH_TOPIC, IMAGE)], 1):
            mangled = "/%" + topic.replace("/", "%") + f"/{kind}/::,7:,:,:,,"
            self.held.append(session.liveliness().declare_token(self.token(number, "MP", mangled)))
            self.publishers[topic] = session.declare_publisher(
                f"{DOMAIN}/{topic}/{kind}", congestion_control=zenoh.CongestionControl.BLOCK
            )
            self.sent[topic] = 0

    def token(self, number, kind, rest):
        return f"@ros2_lv/{DOMAIN}/{self.session.zid()}/0/{number}/{kind}/%/%/python_camera{rest}"

    def has_subscribers(self):
        return all(p.matching_status.matching for p in self.publishers.values())

    def publish(self, topic, nanos, message):
        self.sent[topic] += 1
        attachment = struct.pack("<qqB16s", self.sent[topic], nanos, 16, topic.encode()[:16])
        self.publishers[topic].put(message, attachment=attachment)


def pattern(seed, length):
    """Pixels that differ from one another."""
    return b"".join(hashlib.sha256(struct.pack("<II", seed, n)).digest() for n in range(-(-length // 32)))[:length]


def drive(endpoint, frames):
    with connect(endpoint) as session:
        driver = Driver(session)
        within(PATIENCE_S, driver.has_subscribers, "nobody has subscribed")
        start = time.time_ns()
        color = pattern(1, 3 * WIDTH * HEIGHT)
        depth = struct.pack(f"<{WIDTH * HEIGHT}H", *(1500 + 3 * (n % WIDTH) for n in range(WIDTH * HEIGHT)))
        driver.publish(INFO_TOPIC, start, write_camera(start))
        for number in range(frames):
            nanos = start + number * 33_333_333
            # One pixel tells which frame it is.
            pixels = bytes([number % 256]) + color[1:]
            driver.publish(COLOR_TOPIC, nanos, write_image(nanos, "rgb8", 3 * WIDTH, pixels))
            driver.publish(DEPTH_TOPIC, nanos, write_image(nanos, "16UC1", 2 * WIDTH, depth))
            print(json.dumps({"stamp": nanos, "color": hashlib.sha256(pixels).hexdigest()}))
            time.sleep(0.033)


def main():
    try:
        task, endpoint, frames = sys.argv[1:]
        {"listen": listen, "drive": drive}[task](endpoint, int(frames))
    except (Failure, ValueError, KeyError, zenoh.ZError) as error:
        sys.exit(f"zenoh_ros.py: {error!r}")


if __name__ == "__main__":
    main()
