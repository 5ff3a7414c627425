"""Meets an autopilot with MAVSDK, an independent client: connects, waits until it can be armed, uploads a mission,
downloads it, compares the two, and arms.

usage: mavsdk_mission.py URI [--fly SECONDS]

URI is MAVSDK's, such as udpin://127.0.0.1:14550. With --fly the mission is also started and must end within that time.
Exits 0 if all of it worked, 1 with the reason otherwise.
"""

import argparse
import sys
import time

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, MavsdkError, Vehicle
from mavsdk.plugins.action import Action
from mavsdk.plugins.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.telemetry import Telemetry

WAYPOINT, TAKEOFF, RETURN, CHANGE_SPEED, SET_REVERSE = 16, 22, 20, 178, 194
GLOBAL, RELATIVE_ALTITUDE = 0, 3
METRES_PER_DEGREE = 111_132.0
PATIENCE_S = 30.0


class Failure(Exception):
    """What did not work."""


def wait_for(what, condition, seconds=PATIENCE_S):
    """Polls until `condition()` is true, or fails with `what` it waited for."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if condition():
            return
        time.sleep(0.05)
    raise Failure(f"no {what} within {seconds:.0f} s")


def mission(vehicle, latitude_deg, longitude_deg):
    """A small round from there; the home position comes first, as ArduPilot wants it."""

    def item(command, north_m=0.0, altitude_m=0.0, frame=RELATIVE_ALTITUDE, params=(0.0, 0.0, 0.0, 0.0)):
        sequence = len(items)
        items.append(
            MissionItem(
                seq=sequence,
                frame=frame,
                command=command,
                current=int(sequence == 0),  # MAVSDK insists
                autocontinue=1,
                param1=params[0],
                param2=params[1],
                param3=params[2],
                param4=params[3],
                x=round((latitude_deg + north_m / METRES_PER_DEGREE) * 1e7),
                y=round(longitude_deg * 1e7),
                z=altitude_m,
                mission_type=0,
            )
        )

    items = []
    item(WAYPOINT, frame=GLOBAL, altitude_m=60.0)
    if vehicle == Vehicle.ROVER:
        item(CHANGE_SPEED, params=(1.0, 0.4, -1.0, 0.0))
        for step in range(1, 6):
            item(WAYPOINT, north_m=0.3 * step)
        item(SET_REVERSE, params=(1.0, 0.0, 0.0, 0.0))
        item(WAYPOINT, north_m=0.9)
    else:
        item(TAKEOFF, altitude_m=2.0)
        item(WAYPOINT, north_m=1.5, altitude_m=2.0)
        item(WAYPOINT, north_m=0.5, altitude_m=1.5)
        item(RETURN)
    return items


def differences(sent, read):
    """What came back other than it was sent."""
    if len(sent) != len(read):
        yield f"{len(sent)} items sent, {len(read)} read back"
    fields = ("seq", "frame", "command", "autocontinue", "param1", "param2", "param3", "param4", "x", "y", "z")
    for ours, theirs in zip(sent, read):
        for field in fields:
            a, b = getattr(ours, field), getattr(theirs, field)
            if abs(a - b) > 1e-4 * abs(a) * (field not in ("x", "y")) + (field in ("x", "y")):
                yield f"item {ours.seq}: {field} is {b}, sent was {a}"


def meet(mavsdk, uri, fly_s):
    """The whole conversation."""
    if mavsdk.add_any_connection(uri) != ConnectionResult.SUCCESS:
        raise Failure(f"cannot open {uri}")
    system = mavsdk.first_autopilot(PATIENCE_S)
    if system is None:
        raise Failure(f"no autopilot on {uri} within {PATIENCE_S:.0f} s")
    vehicle = system.vehicle_type()
    print(f"system {system.get_system_id()}: {system.autopilot_type().name} {vehicle.name}")

    telemetry, action, raw = Telemetry(system), Action(system), MissionRaw(system)
    wait_for("health that allows arming", lambda: telemetry.health().is_armable)
    wait_for("home position", lambda: telemetry.health().is_home_position_ok)
    wait_for("position", lambda: abs(telemetry.position().latitude_deg) > 1e-6)
    here = telemetry.position()
    print(f"at {here.latitude_deg:.7f}, {here.longitude_deg:.7f}, battery and sensors healthy")

    sent = mission(vehicle, here.latitude_deg, here.longitude_deg)
    raw.upload_mission(sent)
    found = list(differences(sent, raw.download_mission()))
    if found:
        raise Failure("the mission read back differs: " + "; ".join(found))
    print(f"mission of {len(sent)} items uploaded, read back and equal")

    action.arm()
    wait_for("telemetry that says armed", telemetry.armed)
    print("armed")
    if fly_s is None:
        action.disarm()
        wait_for("telemetry that says disarmed", lambda: not telemetry.armed())
        return
    raw.start_mission()
    wait_for("end of the mission", raw.is_mission_finished, fly_s)
    if vehicle != Vehicle.ROVER:
        wait_for("landing", lambda: not telemetry.armed(), fly_s)
    print("mission done")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("uri", metavar="URI")
    parser.add_argument("--fly", metavar="SECONDS", type=float)
    arguments = parser.parse_args()
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        try:
            meet(mavsdk, arguments.uri, arguments.fly)
        except (Failure, MavsdkError) as error:
            sys.exit(f"mavsdk_mission: {error}")


if __name__ == "__main__":
    main()
