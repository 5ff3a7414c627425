"""Uses an autopilot's parameters and telemetry with MAVSDK, an independent client.

usage: mavsdk_autopilot.py parameters URI
       mavsdk_autopilot.py telemetry URI

URI is MAVSDK's, such as udpin://127.0.0.1:14550. `parameters` lists them all, reads and sets one of whole numbers and one of
any, and tries the wrong type and a name that there is not. `telemetry` prints what a vehicle at rest says of itself, as
one JSON object, then takes away its satellites, sees that it cannot be armed, and gives them back.
Exits 0 if all of it worked, 1 with the reason otherwise.
"""

import json
import sys
import time

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, MavsdkError, Vehicle
from mavsdk.plugins.param import Param, ParamError, ParamResult
from mavsdk.plugins.telemetry import FixType, FlightMode, LandedState, Telemetry

PATIENCE_S = 30.0


class Failure(Exception):
    """What did not work."""


def wait_for(what, condition):
    """Polls until `condition()` is true, or fails with `what` it waited for."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            raise Failure(f"no {what} within {PATIENCE_S:.0f} s")
        time.sleep(0.05)


def expect(what, found, expected):
    if found != expected:
        raise Failure(f"{what}: {found!r}, expected {expected!r}")


def expect_refusal(what, result, call):
    try:
        found = call()
    except ParamError as error:
        if error.result != result:
            raise Failure(f"{what}: {error}, expected {result.name}") from error
        return
    raise Failure(f"{what}: {found!r}, expected {result.name}")


def as_dict(params):
    return {entry.name: entry.value for entry in params}


def parameters(system):
    param = Param(system)
    everything = param.get_all_params()
    whole, real = as_dict(everything.int_params), as_dict(everything.float_params)
    print(f"{len(whole)} of whole numbers, {len(real)} of any")
    if not whole or not real or len(whole) + len(real) != len(everything.int_params) + len(everything.float_params):
        raise Failure("a kind is missing, or a name comes twice")
    expect("custom parameters", list(everything.custom_params), [])

    action, rate, low = "FS_GCS_ENABLE", "SR0_EXTRA2", "BATT_LOW_MAH"
    expect(action, param.get_param_int(action), whole[action])
    expect(low, param.get_param_float(low), real[low])
    param.set_param_int(action, 2)
    param.set_param_int(rate, 7)
    param.set_param_float(low, 812.25)
    expect("what was set", (param.get_param_int(action), param.get_param_int(rate)), (2, 7))
    print("set")
    expect_refusal(f"{low} as a whole number", ParamResult.WRONG_TYPE, lambda: param.get_param_int(low))
    # MAVSDK sends it and refuses the answer, whose type is another: the autopilot has kept the whole of it.
    expect_refusal(f"{action} as any number", ParamResult.WRONG_TYPE, lambda: param.set_param_float(action, 1.5))
    expect_refusal("no such name", ParamResult.TIMEOUT, lambda: param.get_param_int("NO_SUCH_THING"))
    print("refused")


def parameters_again(system):
    """What another client reads, whose memory is not that of the first."""
    everything = Param(system).get_all_params()
    whole, real = as_dict(everything.int_params), as_dict(everything.float_params)
    found = (whole["FS_GCS_ENABLE"], whole["SR0_EXTRA2"], real["BATT_LOW_MAH"])
    expect("what was set, read by another", found, (1, 7, 812.25))
    print("read back by another")


def telemetry(system):
    told = Telemetry(system)
    wait_for("health that allows arming", lambda: told.health_all_ok() and told.health().is_armable)
    wait_for("home", lambda: abs(told.home().latitude_deg) > 1e-6)
    wait_for("position", lambda: abs(told.position().latitude_deg) > 1e-6)
    wait_for("heading", lambda: told.heading().heading_deg == told.heading().heading_deg)
    wait_for("battery", lambda: told.battery().voltage_v > 1.0 and told.battery().capacity_consumed_ah >= 0.0)
    wait_for("fix", lambda: told.gps_info().fix_type == FixType.RTK_FIXED)
    wait_for("attitude", lambda: told.attitude_euler().timestamp_us > 0)
    wait_for("landed state", lambda: told.landed_state() != LandedState.UNKNOWN)
    wait_for("velocity", lambda: told.position_velocity_ned().position.down_m == told.position_velocity_ned().position.down_m)
    wait_for("flight mode", lambda: told.flight_mode() != FlightMode.UNKNOWN)
    position, home, battery, turn = told.position(), told.home(), told.battery(), told.attitude_euler()
    local, raw = told.position_velocity_ned(), told.raw_gps()
    report = {
        "vehicle": Vehicle(system.vehicle_type()).name,
        "position": [position.latitude_deg, position.longitude_deg, position.absolute_altitude_m],
        "relative_altitude_m": position.relative_altitude_m,
        "home": [home.latitude_deg, home.longitude_deg, home.absolute_altitude_m],
        "raw_gps": [raw.latitude_deg, raw.longitude_deg, raw.absolute_altitude_m],
        "satellites": told.gps_info().num_satellites,
        "local_ned_m": [local.position.north_m, local.position.east_m, local.position.down_m],
        "velocity_ned_mps": [local.velocity.north_m_s, local.velocity.east_m_s, local.velocity.down_m_s],
        "heading_deg": told.heading().heading_deg,
        "attitude_deg": [turn.roll_deg, turn.pitch_deg, turn.yaw_deg],
        "battery_v": battery.voltage_v,
        "battery_a": battery.current_battery_a,
        "battery_percent": battery.remaining_percent,
        "landed_state": LandedState(told.landed_state()).name,
        "flight_mode": FlightMode(told.flight_mode()).name,
        "armed": told.armed(),
        "in_air": told.in_air(),
    }
    print(json.dumps(report))
    param = Param(system)
    # With a fence it needs a position to be armed in any mode.
    param.set_param_int("FENCE_ENABLE", 1)
    param.set_param_int("SIM_GPS_DISABLE", 1)
    wait_for("loss of position", lambda: not told.health().is_global_position_ok)
    wait_for("loss of readiness", lambda: not told.health().is_armable and not told.health_all_ok())
    expect("fix", told.gps_info().fix_type, FixType.NO_FIX)
    param.set_param_int("SIM_GPS_DISABLE", 0)
    wait_for("health that allows arming again", lambda: told.health_all_ok() and told.health().is_armable)


def meet(uri, use):
    with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        if mavsdk.add_any_connection(uri) != ConnectionResult.SUCCESS:
            raise Failure(f"cannot open {uri}")
        system = mavsdk.first_autopilot(PATIENCE_S)
        if system is None:
            raise Failure(f"no autopilot on {uri} within {PATIENCE_S:.0f} s")
        use(system)


def main():
    uses = {"parameters": [parameters, parameters_again], "telemetry": [telemetry]}
    if len(sys.argv) != 3 or sys.argv[1] not in uses:
        sys.exit(__doc__)
    try:
        for use in uses[sys.argv[1]]:
            meet(sys.argv[2], use)
    except (Failure, MavsdkError) as error:
        sys.exit(f"mavsdk_autopilot: {error}")


if __name__ == "__main__":
    main()
