"""Uses an autopilot's mission and parameters with pymavlink, message by message, as the protocols are written down.

usage: pymavlink_autopilot.py mission ENDPOINT
       pymavlink_autopilot.py parameters ENDPOINT

ENDPOINT is pymavlink's, such as udpin:127.0.0.1:14550; the autopilot behind it is a copter's. `mission` uploads a mission,
reads it back, asks for what is not there, fails to upload one that the vehicle cannot fly, and clears it. `parameters`
lists them, reads one by name and one by number, sets some, and tries a name that there is not.
Exits 0 if all of it worked, 1 with the reason otherwise.
"""

import os
import sys
import time

os.environ["MAVLINK20"] = "1"  # read when pymavlink is loaded

from pymavlink import mavutil
from pymavlink.dialects.v20 import common

PATIENCE_S = 20.0
SILENCE_S = 2.0
METRES_PER_DEGREE = 111_132.0
GIMBAL = common.MAV_CMD_DO_MOUNT_CONTROL  # no vehicle of ours has one


class Failure(Exception):
    """What did not work."""


class Autopilot:
    """The autopilot at the other end, which hears that a ground station is there."""

    def __init__(self, endpoint):
        self.link = mavutil.mavlink_connection(endpoint, source_system=255, source_component=190)
        heartbeat = self.link.wait_heartbeat(timeout=PATIENCE_S)
        if heartbeat is None:
            raise Failure(f"no heartbeat within {PATIENCE_S:.0f} s")
        self.target = (heartbeat.get_srcSystem(), heartbeat.get_srcComponent())
        self.mav = self.link.mav
        self.mav.heartbeat_send(common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, common.MAV_STATE_ACTIVE)

    def hear(self, kinds, what, condition=lambda _message: True):
        """The next message of these kinds that fulfils the condition and is not for another."""
        deadline = time.monotonic() + PATIENCE_S
        while (left := deadline - time.monotonic()) > 0:
            message = self.link.recv_match(type=kinds, blocking=True, timeout=left)
            if message is None or not condition(message):
                continue
            if getattr(message, "target_system", 255) == 255:
                return message
        raise Failure(f"no {what} within {PATIENCE_S:.0f} s")

    def expect_silence(self, kinds, what):
        message = self.link.recv_match(type=kinds, blocking=True, timeout=SILENCE_S)
        if message is not None:
            raise Failure(f"{what}, yet there came {message}")


# Missions


def mission(here):
    """Items with numbers of every kind: parameters, commands with a place and without, both names of a frame."""

    def item(command, params=(0.0, 0.0, 0.0, 0.0), north_m=0.0, z=0.0, frame=common.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT):
        latitude = here.lat + round(north_m / METRES_PER_DEGREE * 1e7)
        place = (0, 0) if frame == common.MAV_FRAME_MISSION else (latitude, here.lon - 123)
        return (frame, command, int(not items), 1, *params, *place, z)

    items = []
    items.append(item(common.MAV_CMD_NAV_WAYPOINT, z=60.0, frame=common.MAV_FRAME_GLOBAL_INT))
    items.append(item(common.MAV_CMD_NAV_TAKEOFF, z=2.0))
    items.append(item(common.MAV_CMD_DO_CHANGE_SPEED, (1.0, 0.4, -1.0, 0.0), frame=common.MAV_FRAME_MISSION))
    items.append(item(common.MAV_CMD_NAV_WAYPOINT, (0.25, 0.5, 0.0, 90.0), north_m=1.5, z=2.125))
    absolute = common.MAV_FRAME_GLOBAL
    items.append(item(common.MAV_CMD_NAV_LOITER_TIME, (3.0, 0.0, 0.0, 0.0), north_m=-0.5, z=123.5, frame=absolute))
    items.append(item(common.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=common.MAV_FRAME_MISSION))
    return items


# "The _INT frames are the same": deprecated names, and a vehicle may answer with either.
SAME_FRAME = {
    common.MAV_FRAME_GLOBAL_INT: common.MAV_FRAME_GLOBAL,
    common.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: common.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}
FIELDS = ("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")


def upload(pilot, items):
    """Offers the items, hands out what is asked for, and returns the acknowledgement and the order of the questions."""
    pilot.mav.mission_count_send(*pilot.target, len(items), common.MAV_MISSION_TYPE_MISSION)
    asked = []
    while True:
        message = pilot.hear(["MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK"], "question or acknowledgement")
        if message.get_type() == "MISSION_ACK":
            return message, asked
        if message.get_type() != "MISSION_REQUEST_INT":
            raise Failure("it asks for items in degrees as floats")
        asked.append(message.seq)
        pilot.mav.mission_item_int_send(*pilot.target, message.seq, *items[message.seq])


def download(pilot):
    pilot.mav.mission_request_list_send(*pilot.target, common.MAV_MISSION_TYPE_MISSION)
    count = pilot.hear("MISSION_COUNT", "number of items").count
    items = []
    for seq in range(count):
        pilot.mav.mission_request_int_send(*pilot.target, seq, common.MAV_MISSION_TYPE_MISSION)
        message = pilot.hear(["MISSION_ITEM_INT"], f"item {seq}", lambda item: item.seq == seq)
        items.append(tuple(getattr(message, field) for field in FIELDS))
    pilot.mav.mission_ack_send(*pilot.target, common.MAV_MISSION_ACCEPTED, common.MAV_MISSION_TYPE_MISSION)
    return items


def expect_equal(sent, read, what):
    if len(sent) != len(read):
        raise Failure(f"{what}: {len(sent)} items sent, {len(read)} read")
    for seq, (ours, theirs) in enumerate(zip(sent, read)):
        for field, a, b in zip(FIELDS, ours, theirs):
            if field == "frame":
                a, b = SAME_FRAME.get(a, a), SAME_FRAME.get(b, b)
            if abs(a - b) > (1e-6 * abs(a) if isinstance(a, float) else 0):
                raise Failure(f"{what}: {field} of item {seq} is {b}, sent was {a}")


def expect_result(ack, result):
    names = common.enums["MAV_MISSION_RESULT"]
    if ack.type != result:
        raise Failure(f"it answers {names[ack.type].name}, not {names[result].name}")


def missions(endpoint):
    pilot = Autopilot(endpoint)
    here = pilot.hear("GLOBAL_POSITION_INT", "position", lambda position: position.lat != 0)
    sent = mission(here)
    ack, asked = upload(pilot, sent)
    expect_result(ack, common.MAV_MISSION_ACCEPTED)
    if sorted(set(asked)) != list(range(len(sent))):
        raise Failure(f"it asked for {asked}")
    expect_equal(sent, download(pilot), "the mission read back")
    print(f"{len(sent)} items uploaded and read back equal")

    pilot.mav.mission_request_int_send(*pilot.target, len(sent), common.MAV_MISSION_TYPE_MISSION)
    expect_result(pilot.hear("MISSION_ACK", "refusal"), common.MAV_MISSION_INVALID_SEQUENCE)
    print("an item beyond the last refused")

    impossible = list(sent)
    impossible[2] = (common.MAV_FRAME_MISSION, GIMBAL, 0, 1, 0.0, 0.0, 0.0, 0.0, 0, 0, 0.0)
    ack, asked = upload(pilot, impossible)
    expect_result(ack, common.MAV_MISSION_UNSUPPORTED)
    if max(asked) != 2:
        raise Failure(f"it asked for {asked} of a mission that it cannot do from item 2 on")
    expect_equal(sent, download(pilot), "the mission after the refused one")
    print("an impossible mission refused, the old one kept")

    pilot.mav.mission_clear_all_send(*pilot.target, common.MAV_MISSION_TYPE_MISSION)
    expect_result(pilot.hear("MISSION_ACK", "acknowledgement"), common.MAV_MISSION_ACCEPTED)
    if left := download(pilot):
        raise Failure(f"{len(left)} items are left of the cleared mission")
    print("mission cleared")


# Parameters


def listed(pilot):
    """All parameters by name, each as often and under the number that the list says."""
    pilot.mav.param_request_list_send(*pilot.target)
    values = {}
    while len(values) < (count := (value := pilot.hear("PARAM_VALUE", "next parameter")).param_count):
        if value.param_index in values:
            raise Failure(f"parameter {value.param_index} came twice")
        values[value.param_index] = value
        if len(values) == count:
            break
    if sorted(values) != list(range(count)):
        raise Failure(f"{count} parameters, numbered {sorted(values)}")
    return {value.param_id: value for value in values.values()}


def read_parameter(pilot, name="", index=-1):
    pilot.mav.param_request_read_send(*pilot.target, name.encode("ascii"), index)
    return pilot.hear("PARAM_VALUE", f"value of {name or index}")


def set_parameter(pilot, name, value, kind=common.MAV_PARAM_TYPE_REAL32):
    pilot.mav.param_set_send(*pilot.target, name.encode("ascii"), value, kind)
    told = pilot.hear("PARAM_VALUE", f"value of {name}")
    if told.param_id != name:
        raise Failure(f"{name} was set and {told.param_id} told")
    again = read_parameter(pilot, name)
    if (again.param_id, again.param_value) != (name, told.param_value):
        raise Failure(f"{name} was told as {told.param_value} and read as {again.param_value}")
    return told.param_value


def parameters(endpoint):
    pilot = Autopilot(endpoint)
    before = listed(pilot)
    print(f"{len(before)} parameters listed")
    for name, value in before.items():
        if read_parameter(pilot, index=value.param_index).param_id != name:
            raise Failure(f"{name} is not number {value.param_index}")
    if read_parameter(pilot, "WPNAV_SPEED").param_value != before["WPNAV_SPEED"].param_value:
        raise Failure("WPNAV_SPEED read by its name differs")

    if (value := set_parameter(pilot, "WPNAV_SPEED", 72.5)) != 72.5:
        raise Failure(f"WPNAV_SPEED is {value} after it was set to 72.5")
    if (value := set_parameter(pilot, "FS_GCS_ENABLE", 2.0, before["FS_GCS_ENABLE"].param_type)) != 2.0:
        raise Failure(f"FS_GCS_ENABLE is {value} after it was set to 2")
    print("two set and read back")

    pilot.mav.param_set_send(*pilot.target, b"NO_SUCH_THING", 1.0, common.MAV_PARAM_TYPE_REAL32)
    pilot.mav.param_request_read_send(*pilot.target, b"NO_SUCH_THING", -1)
    pilot.mav.param_request_read_send(*pilot.target, b"", len(before))
    pilot.expect_silence("PARAM_VALUE", "there is no such parameter")
    print("unknown names unanswered")

    if set_parameter(pilot, "WPNAV_SPEED", float("nan")) != 72.5:
        raise Failure("WPNAV_SPEED took what is not a number")
    after = listed(pilot)
    changed = sorted(name for name in before if before[name].param_value != after[name].param_value)
    if set(before) != set(after) or changed != ["FS_GCS_ENABLE", "WPNAV_SPEED"]:
        raise Failure(f"{changed} have changed, and the names {set(before) ^ set(after)}")
    print("nothing else changed")


def main():
    uses = {"mission": missions, "parameters": parameters}
    if len(sys.argv) != 3 or sys.argv[1] not in uses:
        sys.exit(__doc__)
    try:
        uses[sys.argv[1]](sys.argv[2])
    except Failure as failure:
        sys.exit(f"pymavlink_autopilot: {failure}")


if __name__ == "__main__":
    main()
