"""Lets an autopilot fail with pymavlink at the other end, and listens to what it says and does.

usage: pymavlink_failures.py battery|silence|fence|arming ENDPOINT

ENDPOINT is pymavlink's, such as udpin:127.0.0.1:14550; behind it is a copter's or a rover's autopilot. `battery`, `silence` (of
the ground station) and `fence` put the vehicle under way first; `arming` tries to arm it with one thing after the other wrong.
Prints what the autopilot says, numbers left out, and what is seen of it elsewhere.
Exits 0 if all of it came about, 1 with the reason otherwise.
"""

import re
import sys
import time

from pymavlink.dialects.v20 import common
from pymavlink_autopilot import METRES_PER_DEGREE, PATIENCE_S, Autopilot, Failure

BATTERY, PREARM, GEOFENCE = (
    common.MAV_SYS_STATUS_SENSOR_BATTERY,
    common.MAV_SYS_STATUS_PREARM_CHECK,
    common.MAV_SYS_STATUS_GEOFENCE,
)
FENCE = common.MAV_MISSION_TYPE_FENCE
FORCE = 21196.0


class Vehicle(Autopilot):
    """An autopilot that hears a heartbeat of ours each second while we are present."""

    def __init__(self, endpoint):
        super().__init__(endpoint)
        self.present, self.beaten, self.texts = True, 0.0, []
        self.last = {}
        heartbeat = self.until("heartbeat", lambda: self.last.get("HEARTBEAT"))
        self.copter = heartbeat.type == common.MAV_TYPE_QUADROTOR
        self.here = self.until("position", lambda: self.last.get("GLOBAL_POSITION_INT"))

    def listen(self):
        """Takes in what comes within a tenth of a second."""
        if self.present and time.monotonic() - self.beaten > 0.9:
            self.beaten = time.monotonic()
            self.mav.heartbeat_send(common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID, 0, 0, common.MAV_STATE_ACTIVE)
        message = self.link.recv_match(blocking=True, timeout=0.1)
        if message is None or message.get_srcComponent() != self.target[1]:
            return
        self.last[message.get_type()] = message
        if message.get_type() == "STATUSTEXT":
            self.texts.append(message.text)

    def until(self, what, condition, seconds=2 * PATIENCE_S):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.listen()
            if found := condition():
                return found
        raise Failure(f"no {what} within {seconds:.0f} s; said: {self.texts}")

    def command(self, number, *params):
        self.last.pop("COMMAND_ACK", None)
        padded = [*params, *[0.0] * (7 - len(params))]
        self.mav.command_long_send(*self.target, number, 0, *padded)
        return self.until("answer", lambda: (a := self.last.get("COMMAND_ACK")) and a.command == number and a).result

    def obey(self, what, number, *params):
        if (result := self.command(number, *params)) != common.MAV_RESULT_ACCEPTED:
            raise Failure(f"{what} is answered by {result}; said: {self.texts}")

    def mode(self, copter, rover):
        self.obey("mode", common.MAV_CMD_DO_SET_MODE, 1, copter if self.copter else rover)

    def until_mode(self, name, copter, rover):
        number = copter if self.copter else rover
        self.until(name, lambda: self.last["HEARTBEAT"].custom_mode == number)
        print(f"mode {name}")

    def set(self, name, value):
        self.last.pop("PARAM_VALUE", None)
        self.mav.param_set_send(*self.target, name.encode("ascii"), value, common.MAV_PARAM_TYPE_REAL32)
        told = self.until(name, lambda: (v := self.last.get("PARAM_VALUE")) and v.param_id == name and v)
        if abs(told.param_value - value) > 1e-3:
            raise Failure(f"{name} is {told.param_value} after it was set to {value}")

    def expect_text(self, words):
        """Waits for that text, and prints it without its numbers."""
        text = self.until(f"{words!r}", lambda: next((text for text in self.texts if text.startswith(words)), None))
        print(re.sub(r" [\d.]+(?=V| mAh)", " _", text))

    def until_health(self, bit, well):
        self.until("health", lambda: bool(self.last["SYS_STATUS"].onboard_control_sensors_health & bit) == well)

    def send_north(self, metres):
        latitude = self.here.lat + round(metres / METRES_PER_DEGREE * 1e7)
        frame = common.MAV_FRAME_GLOBAL_RELATIVE_ALT
        reposition = common.MAV_CMD_DO_REPOSITION
        self.mav.command_int_send(*self.target, frame, reposition, 0, 0, -1, 1, 0, 0, latitude, self.here.lon, 2.0)

    def get_under_way(self):
        self.mode(4, 15)
        self.obey("arming", common.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if self.copter:
            self.obey("take-off", common.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 2.0)
            self.until("height", lambda: self.last["GLOBAL_POSITION_INT"].relative_alt > 1500)
        self.send_north(30.0)
        self.until("speed", lambda: abs(self.last["GLOBAL_POSITION_INT"].vx) > 20)
        self.texts.clear()


def battery(vehicle):
    vehicle.set("BATT_FS_LOW_ACT", 2.0 if vehicle.copter else 1.0)
    vehicle.get_under_way()
    vehicle.set("BATT_LOW_MAH", 6000.0)
    vehicle.expect_text("Battery 1 is low")
    if vehicle.copter:
        vehicle.expect_text("Battery Failsafe")
    vehicle.until_mode("RTL", 6, 11)
    low = common.MAV_BATTERY_CHARGE_STATE_LOW
    vehicle.until("charge state", lambda: (b := vehicle.last.get("BATTERY_STATUS")) and b.charge_state == low)
    vehicle.until_health(BATTERY, False)
    print("battery low and unwell")


def silence(vehicle):
    vehicle.set("FS_GCS_ENABLE", 1.0)
    if not vehicle.copter:
        vehicle.set("FS_ACTION", 1.0)
    vehicle.get_under_way()
    vehicle.present = False
    vehicle.expect_text("GCS Failsafe")
    vehicle.until_mode("RTL", 6, 11)
    critical = common.MAV_STATE_CRITICAL
    vehicle.until("state", lambda: vehicle.last["HEARTBEAT"].system_status == critical)
    print("critical")
    vehicle.present = True
    vehicle.expect_text("GCS Failsafe Cleared")


def upload_fence(vehicle, corners_m):
    """A polygon to stay within, in metres north and east of here."""
    vehicle.mav.mission_count_send(*vehicle.target, len(corners_m), FENCE)
    asked = -1
    while True:
        kinds = ("MISSION_REQUEST_INT", "MISSION_ACK")
        for kind in kinds:
            vehicle.last.pop(kind, None)
        message = vehicle.until("question", lambda: next((vehicle.last[kind] for kind in kinds if kind in vehicle.last), None))
        if message.mission_type != FENCE:
            raise Failure(f"a fence is answered by {message}")
        if message.get_type() == "MISSION_ACK":
            if (message.type, asked) != (common.MAV_MISSION_ACCEPTED, len(corners_m) - 1):
                raise Failure(f"the fence is answered by {message}, after item {asked}")
            return
        asked = message.seq
        north, east = corners_m[asked]
        place = (vehicle.here.lat + round(north / METRES_PER_DEGREE * 1e7), vehicle.here.lon + round(east / METRES_PER_DEGREE * 1.6e7))
        corner = common.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
        vehicle.mav.mission_item_int_send(
            *vehicle.target, asked, common.MAV_FRAME_GLOBAL, corner, 0, 1, len(corners_m), 0, 0, 0, *place, 0.0, FENCE
        )


def fence(vehicle):
    upload_fence(vehicle, [(-5.0, -5.0), (-5.0, 5.0), (5.0, 5.0), (5.0, -5.0)])
    print("fence uploaded")
    vehicle.get_under_way()
    vehicle.obey("fence", common.MAV_CMD_DO_FENCE_ENABLE, 1)
    vehicle.expect_text("Max Alt, Circle and Polygon fences enabled" if vehicle.copter else "Circle and Polygon fences enabled")
    told = vehicle.until("breach", lambda: (f := vehicle.last.get("FENCE_STATUS")) and f.breach_status and f)
    print(f"{common.enums['FENCE_BREACH'][told.breach_type].name}, {told.breach_count} in all")
    vehicle.until_health(GEOFENCE, False)
    if vehicle.copter:
        vehicle.expect_text("Polygon fence breached")
    vehicle.until_mode("RTL", 6, 11)
    vehicle.expect_text("Manual recovery started")
    vehicle.until("end of the breach", lambda: not vehicle.last["FENCE_STATUS"].breach_status)
    if vehicle.copter:
        vehicle.expect_text("Fence breach cleared")
    vehicle.until_health(GEOFENCE, True)
    print("back inside")


def arming(vehicle):
    arm = common.MAV_CMD_COMPONENT_ARM_DISARM

    def expect_refusal(words):
        vehicle.texts.clear()
        if vehicle.command(arm, 1) != common.MAV_RESULT_FAILED:
            raise Failure(f"it arms, instead of saying {words!r}")
        vehicle.expect_text(words)

    vehicle.mode(4, 15)
    vehicle.set("SIM_GPS_DISABLE", 1.0)
    vehicle.until_health(PREARM, False)
    expect_refusal("Arm: GPS 1: Bad fix")
    vehicle.set("SIM_GPS_DISABLE", 0.0)
    vehicle.until_health(PREARM, True)
    vehicle.set("BATT_ARM_VOLT", 30.0)
    expect_refusal("Arm: Battery 1 below minimum arming voltage")
    vehicle.obey("checks", common.MAV_CMD_RUN_PREARM_CHECKS)
    vehicle.expect_text("PreArm: Battery 1 below minimum arming voltage")
    vehicle.set("BATT_ARM_VOLT", 0.0)
    vehicle.until_health(PREARM, True)
    vehicle.set("FENCE_ENABLE", 1.0)
    vehicle.set("FENCE_RADIUS", 1.0)
    vehicle.until_health(PREARM, False)  # the fence is switched on a little after its parameter
    expect_refusal("Arm: Circle FENCE_MARGIN is less than FENCE_RADIUS")
    vehicle.set("FENCE_ENABLE", 0.0)
    vehicle.until_health(PREARM, True)
    vehicle.set("ARMING_MIS_ITEMS", 64.0)
    expect_refusal("Arm: Missing mission item: RTL")
    vehicle.set("ARMING_MIS_ITEMS", 0.0)
    vehicle.mode(6, 11)
    expect_refusal("Arm: RTL mode not armable" if vehicle.copter else "Arm: Mode not armable")
    vehicle.mode(4, 15)
    vehicle.set("BATT_ARM_VOLT", 30.0)
    vehicle.obey("arming by force", arm, 1, FORCE)
    vehicle.expect_text("Arming motors" if vehicle.copter else "Throttle armed")


def main():
    uses = {"battery": battery, "silence": silence, "fence": fence, "arming": arming}
    if len(sys.argv) != 3 or sys.argv[1] not in uses:
        sys.exit(__doc__)
    try:
        uses[sys.argv[1]](Vehicle(sys.argv[2]))
    except Failure as failure:
        sys.exit(f"pymavlink_failures: {failure}")


if __name__ == "__main__":
    main()
