"""Runs ORB-SLAM3 (PyPI pyorbslam3) on a job of `evaluate slam`, and trains the vocabulary that it needs.

    orbslam3.py VOCABULARY train RECORDING...     on the colour pictures of recordings, unless VOCABULARY is there
    orbslam3.py VOCABULARY run JOB

It is set up as its authors set it up for TUM RGB-D: 1000 features, 8 levels, FAST thresholds 20 and 7, close points within 40
baselines. What is measured is what ours is: tracking and what goes on behind it, not reading pictures or the vocabulary.
"""

import json
import math
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

BRANCHES = 10
LEVELS = 4
PICTURES = 240
FEATURES = 600


def associations(recording):
    """Stamp, colour and depth of each frame, in order of time."""
    listed = recording / "associations.txt"
    if listed.is_file():
        frames = []
        for words in lines(listed):
            colour, depth = (1, 3) if "depth" not in words[1] else (3, 1)
            frames.append((words[colour - 1], recording / words[colour], recording / words[depth]))
        frames.sort(key=lambda frame: float(frame[0]))
        return [frame for frame in frames if frame[1].is_file() and frame[2].is_file()]
    colours, depths = (
        [(float(words[0]), words[0], recording / words[1]) for words in lines(recording / name)]
        for name in ("rgb.txt", "depth.txt")
    )
    frames = []
    for at, stamp, colour in colours:
        nearest = min(depths, key=lambda depth: abs(depth[0] - at))
        if abs(nearest[0] - at) < 0.02:
            frames.append((stamp, colour, nearest[2]))
    return frames


def lines(path):
    """The words of each line that is no comment."""
    split = [line.split() for line in path.read_text().splitlines()]
    return [words for words in split if words and not words[0].startswith("#")]


def pictures(folder):
    """All colour pictures of a recording."""
    if (folder / "associations.txt").is_file() or (folder / "rgb.txt").is_file():
        return [colour for _, colour, _ in associations(folder)]
    return sorted(folder.glob("*.color.jpg"))


def train(vocabulary, folders):
    """Clusters ORB descriptors into a tree of words, in the text format of DBoW2."""
    found = [path for folder in folders for path in pictures(Path(folder))]
    if not found:
        sys.exit("there are no recordings to train ORB-SLAM3's vocabulary on: name their folder with --data")
    chosen = found[:: max(1, len(found) // PICTURES)]
    orb = cv2.ORB_create(nfeatures=FEATURES)
    descriptors, owners = [], []
    for index, path in enumerate(chosen):
        _, described = orb.detectAndCompute(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), None)
        if described is not None:
            descriptors.append(described)
            owners.append(np.full(len(described), index))
    descriptors = np.ascontiguousarray(np.concatenate(descriptors))
    owners = np.concatenate(owners)
    random = np.random.default_rng(1)
    nodes = []
    grow(nodes, 0, (descriptors, owners), (1, len(chosen)), random)
    text = [f"{BRANCHES} {LEVELS} 0 0"]
    for parent, is_word, centre, weight in nodes:
        text.append(f"{parent} {int(is_word)} {' '.join(map(str, centre))} {weight:.6f}")
    partial = vocabulary.with_suffix(".partial")
    partial.write_text("\n".join(text) + "\n")
    partial.rename(vocabulary)


def grow(nodes, parent, members, level_and_count, random):
    """Adds the children of a node and all that is below them."""
    (descriptors, owners), (level, count) = members, level_and_count
    for centre, mine in clusters(descriptors, random):
        is_word = level == LEVELS or len(mine) <= BRANCHES
        weight = math.log(count / len(np.unique(owners[mine]))) if is_word else 0.0
        nodes.append((parent, is_word, centre, weight))
        if not is_word:
            grow(nodes, len(nodes), (descriptors[mine], owners[mine]), (level + 1, count), random)


def clusters(descriptors, random):
    """k-majority: centres of bits, by Hamming distance."""
    words = descriptors.view(np.uint64)
    centres = descriptors[random.choice(len(descriptors), min(BRANCHES, len(descriptors)), replace=False)]
    for _ in range(8):
        distance = np.stack(
            [np.bitwise_count(words ^ centre.view(np.uint64)).sum(axis=1, dtype=np.int32) for centre in centres]
        )
        nearest = distance.argmin(axis=0)
        for index in range(len(centres)):
            mine = descriptors[nearest == index]
            if len(mine):
                majority = np.unpackbits(mine, axis=1).mean(axis=0) >= 0.5
                centres[index] = np.packbits(majority)
    for index in range(len(centres)):
        mine = np.flatnonzero(nearest == index)
        if len(mine):
            yield centres[index], mine


def settings(job):
    """What ORB-SLAM3 reads."""
    lens = job["camera"]
    k1, k2, p1, p2, k3 = lens["distortion"]
    return f"""%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: {lens["fx"]}
Camera1.fy: {lens["fy"]}
Camera1.cx: {lens["cx"]}
Camera1.cy: {lens["cy"]}
Camera1.k1: {k1}
Camera1.k2: {k2}
Camera1.p1: {p1}
Camera1.p2: {p2}
Camera1.k3: {k3}
Camera.width: {lens["width"]}
Camera.height: {lens["height"]}
Camera.fps: 30
Camera.RGB: 0
Stereo.ThDepth: 40.0
Stereo.b: 0.07732
RGBD.DepthMapFactor: {job["depth_factor"]}
ORBextractor.nFeatures: 1000
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""


def floats(text):
    """OpenCV's reader takes `0` for an integer where a real number is asked for."""
    def real(line):
        key, _, value = line.partition(": ")
        is_real = key.startswith(("Camera1.", "RGBD.", "Stereo.")) and "." not in value and "e" not in value
        return f"{key}: {value}.0" if is_real else line
    return "\n".join(real(line) for line in text.splitlines()) + "\n"


def run(vocabulary, file):
    """Runs the job and leaves its trajectory and what it cost."""
    import pyorbslam3

    job = json.loads(Path(file).read_text())
    out = Path(job["out"]) / job["method"]
    frames = associations(Path(job["recording"]))
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as configuration:
        configuration.write(floats(settings(job)))
        configuration.flush()
        slam = pyorbslam3.Slam(str(vocabulary), configuration.name, pyorbslam3.Sensor.RGBD)
    started, outside = time.process_time(), 0.0
    took, tracked = [], 0
    for stamp, colour, depth in frames:
        before = time.thread_time()
        colour = cv2.imread(str(colour), cv2.IMREAD_COLOR)
        depth = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
        depth[depth == 65535] = 0
        depth = depth.astype(np.float32)
        outside += time.thread_time() - before
        before = time.perf_counter()
        result = slam.track_rgbd(colour, depth, float(stamp))
        took.append(1e3 * (time.perf_counter() - before))
        tracked += bool(result.ok)
    slam.shutdown()
    cpu = time.process_time() - started - outside
    slam.save_trajectory_tum(str(out) + ".txt")
    took.sort()
    at = lambda share: took[max(0, math.ceil(share * len(took)) - 1)]
    measured = {
        "frames": len(took),
        "tracked": tracked,
        "fps": 1e3 * len(took) / sum(took),
        "p50_ms": at(0.5),
        "p99_ms": at(0.99),
        "cpu_ms": 1e3 * cpu / len(took),
        "peak_mb": peak_mb(),
    }
    Path(str(out) + ".json").write_text(json.dumps(measured))


def peak_mb():
    """The most memory that was resident, in 10⁶ bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / 1e6
    return None


def main():
    vocabulary, command, *arguments = sys.argv[1:]
    vocabulary = Path(vocabulary)
    if command == "run":
        run(vocabulary, arguments[0])
    elif not vocabulary.is_file():
        train(vocabulary, arguments)


if __name__ == "__main__":
    main()
