"""Reads a split in OPV2V's layout as OpenCOOD's base dataset does, and says what is in it.

    opv2v_reader.py OPV2V_SPLIT TANDEM_SPLIT

The second folder has the same sequences and moments in our own layout: its instance masks tell whether extrinsics and
intrinsics take the middle of each car to where the camera shows it. Prints one JSON object; any fault is an exception.
"""

import json
import re
import sys
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

CAMERAS = {0: "ugv_front", 1: "ugv_right", 2: "ugv_left", 3: "ugv_rear"}
BEV = ["dynamic", "static", "lane", "visibility", "visibility_corp"]
CAR = 11

# Numbers as OpenCOOD's loader takes them.
Loader = type("Loader", (yaml.SafeLoader,), {})
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"""^(?:[-+]?(?:[0-9][0-9_]*)\.[0-9_]*(?:[eE][-+]?[0-9]+)?
        |[-+]?(?:[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)
        |\.[0-9_]+(?:[eE][-+][0-9]+)?)$""",
        re.X,
    ),
    list("-+0123456789."),
)


def matrix(pose):
    """From the frame at [x, y, z, roll, yaw, pitch] to CARLA's world: turned about x, then y, then z."""
    x, y, z, *angles = pose
    (cr, cy, cp), (sr, sy, sp) = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    roll = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    result = np.eye(4)
    result[:3, :3] = yaw @ pitch @ roll
    result[:3, 3] = x, y, z
    return result


def cloud(path):
    """Points and the red of their colours, which is the intensity, from a binary PCD file of `x y z rgb`."""
    header, data = path.read_bytes().split(b"DATA binary\n", 1)
    fields = dict(line.split(" ", 1) for line in header.decode().splitlines() if not line.startswith("#"))
    assert fields["FIELDS"] == "x y z rgb" and fields["SIZE"] == "4 4 4 4", fields
    rows = np.frombuffer(data, dtype=[("point", "<f4", 3), ("rgb", "<u4")])
    assert len(rows) == int(fields["POINTS"]) == int(fields["WIDTH"])
    return rows["point"].astype(float), (rows["rgb"] >> 16 & 255) / 255


def move(transform, points):
    return points @ transform[:3, :3].T + transform[:3, 3]


def box(vehicle):
    """From the middle of a box to the world, and its half sizes."""
    place = np.add(vehicle["location"], vehicle["center"])
    return matrix([*place, *vehicle["angle"]]), np.array(vehicle["extent"])


def check_numbers(value):
    if isinstance(value, dict):
        value = value.values()
    if isinstance(value, (int, float, str)) or value is None:
        assert isinstance(value, float), repr(value)
        return
    for part in value:
        check_numbers(part)


def agents_of(scenario):
    """The ego comes first, roadside units last."""
    agents = sorted(path.name for path in scenario.iterdir() if path.is_dir())
    assert agents
    if int(agents[0]) < 0:
        agents = agents[1:] + [agents[0]]
    return agents


def load(scenario, agent, time):
    folder = scenario / agent
    with open(folder / f"{time}.yaml") as file:
        params = yaml.load(file, Loader)
    for key in ["lidar_pose", "true_ego_pos", "predicted_ego_pos", "ego_speed", "plan_trajectory"]:
        check_numbers(params[key])
    assert len(params["lidar_pose"]) == len(params["true_ego_pos"]) == len(params["predicted_ego_pos"]) == 6
    for index in range(4):
        camera = params[f"camera{index}"]
        check_numbers(camera)
        # The extrinsic is what the poses say: LiDAR to camera.
        extrinsic = np.linalg.inv(matrix(camera["cords"])) @ matrix(params["lidar_pose"])
        assert np.abs(extrinsic - np.array(camera["extrinsic"])).max() < 1e-5
        with Image.open(folder / f"{time}_camera{index}.png") as picture:
            picture.load()
            assert picture.mode == "RGB", picture.mode
    for name in BEV:
        with Image.open(folder / f"{time}_bev_{name}.png") as picture:
            assert picture.size == (256, 256), picture.size
    for key, vehicle in params["vehicles"].items():
        assert isinstance(key, int)
        check_numbers(vehicle)
        assert set(vehicle) == {"angle", "center", "extent", "location", "speed"}, vehicle
    return params, cloud(folder / f"{time}.pcd")


def project(params, index, point_in_lidar):
    """Pixel of a point, from UE4's axes to those of a picture; `None` behind the camera."""
    camera = params[f"camera{index}"]
    x, y, z = move(np.array(camera["extrinsic"]), point_in_lidar)
    u, v, depth = np.array(camera["intrinsic"]) @ [y, -z, x]
    return (round(u / depth), round(v / depth)) if depth > 0.3 else None


def check_masks(params, agent, tandem, time):
    """How many cars in clear sight are where the instance masks show them."""
    told = json.loads((tandem / f"{time}.json").read_text())
    side, cameras = ("uav", {0: "uav"}) if int(agent) < 0 else ("ugv", CAMERAS)
    clear = {
        item["instance"]
        for item in told["objects"]
        if item["class"] == CAR and item[side] and item[side]["occlusion"] < 0.02 and item[side]["visible_pixels"] > 300
    }
    count = 0
    lidar_from_world = np.linalg.inv(matrix(params["lidar_pose"]))
    for key in clear & set(params["vehicles"]):
        middle = move(lidar_from_world, box(params["vehicles"][key])[0][:3, 3])
        for index, name in cameras.items():
            mask = np.asarray(Image.open(tandem / f"{time}_{name}_instance.png"))
            pixel = project(params, index, middle)
            if pixel and 0 <= pixel[0] < mask.shape[1] and 0 <= pixel[1] < mask.shape[0]:
                assert mask[pixel[1], pixel[0]] == key, f"{key} is not at {pixel} of {name} at {time}"
                count += 1
    return count


def main():
    root, tandem_root = map(Path, sys.argv[1:])
    found = {"scenarios": 0, "frames": 0, "agents": [], "points": [], "vehicles": 0, "projected": 0, "shared": 0}
    for scenario in sorted(path for path in root.iterdir() if path.is_dir()):
        protocol = yaml.safe_load((scenario / "data_protocol.yaml").read_text())
        assert protocol["world"]["scene"] in scenario.name
        agents = agents_of(scenario)
        found["agents"].append([int(agent) for agent in agents])
        yamls = {a: sorted(p.stem for p in (scenario / a).glob("*.yaml") if "additional" not in p.name) for a in agents}
        assert all(times == yamls[agents[0]] for times in yamls.values())
        for time in yamls[agents[0]]:
            loaded = {agent: load(scenario, agent, time) for agent in agents}
            ego_from_world = np.linalg.inv(matrix(loaded[agents[0]][0]["lidar_pose"]))
            merged = {}
            for agent, (params, (points, intensity)) in loaded.items():
                assert 0 <= intensity.min() <= intensity.max() <= 1 and intensity.max() > 0.2
                assert int(agent) not in params["vehicles"]
                world_from_lidar = matrix(params["lidar_pose"])
                # Communication range, and the range of heights of both clouds.
                assert np.linalg.norm((ego_from_world @ world_from_lidar)[:2, 3]) < 70
                ground = move(ego_from_world @ world_from_lidar, points)
                counts, edges = np.histogram(ground[:, 2], np.arange(-3, 3, 0.1))
                lowest = edges[(counts > counts.max() / 4).argmax()]
                assert -1.45 < lowest < -1.15, f"the ground is at {lowest}, not 1.2 m below the LiDAR"
                for key, vehicle in params["vehicles"].items():
                    world_from_box, extent = box(vehicle)
                    local = move(np.linalg.inv(world_from_box) @ world_from_lidar, points)
                    inside = (np.abs(local) <= extent + 1e-3).all(axis=1).sum()
                    assert inside > 0, f"vehicle {key} of agent {agent} at {time} has no point"
                    if key in merged:
                        assert vehicle == merged[key]
                        found["shared"] += 1
                    merged[key] = vehicle
                found["points"].append(len(points))
                found["projected"] += check_masks(params, agent, tandem_root / scenario.name, time)
            found["vehicles"] += len(merged)
            found["frames"] += 1
        found["scenarios"] += 1
    print(json.dumps(found))


main()
