"""Every field of the messages on the wire: literal numbers in the units and frames of common.xml.

Each field of a row has another number, so that no two can be mixed up. The frames are made and read
by pymavlink; test_literal_bytes.py has other messages.
"""

import math

import numpy as np
import pytest

from mavlink_bridge.wire import messages as m
from mavlink_bridge.wire.codec import Codec
from tests.mavlink_bridge.wire.fields import heard, shown, written

# Heading 45°, pitched up by 36.9°, as (w, x, y, z): FLU → ENU, and FRD → NED.
_C, _S, _A, _B = math.cos(math.pi / 8), math.sin(math.pi / 8), 3 / math.sqrt(10), 1 / math.sqrt(10)
NORTH_EAST_UP = np.array([_C * _A, _S * _B, -_C * _B, _S * _A])
NED_OF_IT = [_C * _A, -_S * _B, _C * _B, _S * _A]
NAN = math.nan
TARGET = {"target_system": 3, "target_component": 191}

BOTH = [
    (
        "HEARTBEAT",
        {"type": 2, "autopilot": 12, "base_mode": 0x51, "custom_mode": 0x04030000,
         "system_status": 3, "mavlink_version": 3},
        m.Heartbeat(12, 2, False, 0x04030000, 3, 0x51),
    ),
    (
        "SYS_STATUS",
        {"onboard_control_sensors_present": 0x31, "onboard_control_sensors_enabled": 0x21,
         "onboard_control_sensors_health": 0x11, "load": 217, "voltage_battery": 15873,
         "current_battery": 1234, "battery_remaining": 57,
         **dict.fromkeys(("drop_rate_comm", "errors_comm", "errors_count1", "errors_count2",
                          "errors_count3", "errors_count4"), 0)},
        m.SystemStatus(0x31, 0x21, 0x11, 15.873, 12.34, 0.57, 0.217),
    ),
    (
        "BATTERY_STATUS",
        {"id": 0, "battery_function": 0, "type": 3, "temperature": 32767,
         "voltages": [15873] + [65535] * 9, "current_battery": 1234, "current_consumed": -1,
         "energy_consumed": -1, "battery_remaining": 57},
        m.BatteryStatus(15.873, 12.34, 0.57),
    ),
    (
        "HOME_POSITION",
        {"latitude": 471234567, "longitude": -85432101, "altitude": 430517, "x": 1.5, "y": -2.25,
         "z": -3.125, "q": [NAN] * 4, "approach_x": NAN, "approach_y": NAN, "approach_z": NAN},
        m.HomePosition(47.1234567, -8.5432101, 430.517, np.array([-2.25, 1.5, 3.125])),
    ),
    (
        "GPS_RAW_INT",
        {"time_usec": 2000003, "fix_type": 6, "lat": 471234567, "lon": -85432101, "alt": 430517,
         "eph": 71, "epv": 113, "vel": 1234, "cog": 3000, "satellites_visible": 9, "h_acc": 14,
         "v_acc": 23, "vel_acc": 57},
        m.GpsRaw(2.000003, 6, 47.1234567, -8.5432101, 430.517, 9, 12.34, math.pi / 3, 0.71, 1.13,
                 0.014, 0.023, 0.057),
    ),
    (
        "GPS_INPUT",
        {"time_usec": 2000003, "gps_id": 0, "ignore_flags": 0, "time_week_ms": 0, "time_week": 0,
         "fix_type": 3, "lat": 471234567, "lon": -85432101, "alt": 430.5, "hdop": 0.8, "vdop": 1.2,
         "vn": 1.5, "ve": -2.25, "vd": -3.125, "speed_accuracy": 0.1, "horiz_accuracy": 0.5,
         "vert_accuracy": 0.8, "satellites_visible": 9},
        m.GpsInput(2.000003, 3, 47.1234567, -8.5432101, 430.5, np.array([-2.25, 1.5, 3.125]), 9),
    ),
    (
        "GPS_INPUT",  # 16: GPS_INPUT_IGNORE_FLAG_VEL_VERT
        {"time_usec": 2000003, "gps_id": 0, "ignore_flags": 16, "time_week_ms": 0, "time_week": 0,
         "fix_type": 3, "lat": 471234567, "lon": -85432101, "alt": 430.5, "hdop": 0.8, "vdop": 1.2,
         "vn": 1.5, "ve": -2.25, "vd": 0.0, "speed_accuracy": 0.1, "horiz_accuracy": 0.5,
         "vert_accuracy": 0.8, "satellites_visible": 9},
        m.GpsInput(2.000003, 3, 47.1234567, -8.5432101, 430.5, np.array([-2.25, 1.5]), 9),
    ),
    (
        "GPS_INPUT",  # and 8: GPS_INPUT_IGNORE_FLAG_VEL_HORIZ
        {"time_usec": 2000003, "gps_id": 0, "ignore_flags": 24, "time_week_ms": 0, "time_week": 0,
         "fix_type": 3, "lat": 471234567, "lon": -85432101, "alt": 430.5, "hdop": 0.8, "vdop": 1.2,
         "vn": 0.0, "ve": 0.0, "vd": 0.0, "speed_accuracy": 0.1, "horiz_accuracy": 0.5,
         "vert_accuracy": 0.8, "satellites_visible": 9},
        m.GpsInput(2.000003, 3, 47.1234567, -8.5432101, 430.5, None, 9),
    ),
    (
        "GLOBAL_POSITION_INT",
        {"time_boot_ms": 2003, "lat": 471234567, "lon": -85432101, "alt": 430517,
         "relative_alt": 2019, "vx": 150, "vy": -225, "vz": -312, "hdg": 65535},
        m.GlobalPosition(2.003, 47.1234567, -8.5432101, 430.517, 2.019,
                         np.array([-2.25, 1.5, 3.12])),
    ),
    (
        "AUTOPILOT_VERSION",
        {"capabilities": 8199, "flight_sw_version": 0x010F00FF, "middleware_sw_version": 0,
         "os_sw_version": 0, "board_version": 0, "flight_custom_version": [0] * 8,
         "middleware_custom_version": [0] * 8, "os_custom_version": [0] * 8, "vendor_id": 0,
         "product_id": 0, "uid": 77},
        m.AutopilotVersion(8199, 0x010F00FF, 77),
    ),
    ("SYSTEM_TIME", {"time_unix_usec": 1700000000000003, "time_boot_ms": 12503},
     m.SystemTime(12.503, 1700000000.000003)),
    ("SET_MODE", {"target_system": 3, "base_mode": 209, "custom_mode": 0x00060000},
     m.SetMode(3, 209, 0x00060000)),
    ("COMMAND_LONG",
     {**TARGET, "command": 511, "confirmation": 2,
      **{f"param{n}": float(n) for n in range(1, 8)}},
     m.Command(511, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), 3, 191, 2)),
    ("COMMAND_ACK",
     {**TARGET, "command": 511, "result": 4, "progress": 0, "result_param2": 0},
     m.CommandAck(511, 4, 3, 191)),
    ("STATUSTEXT", {"severity": 5, "text": b"taking off", "id": 300, "chunk_seq": 2},
     m.StatusText(5, "taking off", 300, 2)),
    ("PARAM_REQUEST_LIST", TARGET, m.ParamRequestList(3, 191)),
    ("PARAM_SET", {**TARGET, "param_id": b"SIXTEEN_LONG_NAM", "param_value": 2.5, "param_type": 9},
     m.ParamSet(3, 191, "SIXTEEN_LONG_NAM", 2.5, 9)),
    ("PARAM_ERROR", {**TARGET, "param_id": b"COM_RC_LOSS", "param_index": -1, "error": 7},
     m.ParamError(3, 191, "COM_RC_LOSS", -1, 7)),
    ("MISSION_COUNT", {**TARGET, "count": 300, "mission_type": 2}, m.MissionCount(3, 191, 300, 2)),
    ("MISSION_REQUEST_LIST", {**TARGET, "mission_type": 2}, m.MissionRequestList(3, 191, 2)),
    ("MISSION_REQUEST_INT", {**TARGET, "seq": 300, "mission_type": 2},
     m.MissionRequest(3, 191, 300, 2)),
    ("MISSION_REQUEST", {**TARGET, "seq": 300, "mission_type": 2},
     m.MissionRequest(3, 191, 300, 2, floating=True)),
    ("MISSION_ACK", {**TARGET, "type": 5, "mission_type": 2}, m.MissionAck(3, 191, 5, 2)),
    ("MISSION_SET_CURRENT", {**TARGET, "seq": 300}, m.MissionSetCurrent(3, 191, 300)),
    ("MISSION_CLEAR_ALL", {**TARGET, "mission_type": 2}, m.MissionClearAll(3, 191, 2)),
    ("MISSION_CURRENT", {"seq": 300}, m.MissionCurrent(300)),
    ("MISSION_ITEM_REACHED", {"seq": 300}, m.MissionItemReached(300)),
    ("MISSION_ITEM_INT",
     {**TARGET, "seq": 300, "frame": 6, "command": 16, "current": 1, "autocontinue": 0,
      "param1": 1.5, "param2": 2.5, "param3": 3.5, "param4": NAN, "x": 471234567, "y": -85432101,
      "z": 20.25, "mission_type": 2},
     m.MissionItem(3, 191, 300, 6, 16, 1, 0, (1.5, 2.5, 3.5, NAN), 47.1234567, -8.5432101, 20.25,
                   2)),
    ("MISSION_ITEM_INT",  # INT32_MAX: no place
     {**TARGET, "seq": 300, "frame": 6, "command": 20, "current": 0, "autocontinue": 1,
      "param1": 1.5, "param2": 2.5, "param3": 3.5, "param4": 4.5, "x": 2147483647,
      "y": 2147483647, "z": 20.25, "mission_type": 0},
     m.MissionItem(3, 191, 300, 6, 20, 0, 1, (1.5, 2.5, 3.5, 4.5), NAN, NAN, 20.25, 0)),
    ("MISSION_ITEM",
     {**TARGET, "seq": 300, "frame": 3, "command": 16, "current": 1, "autocontinue": 0,
      "param1": 1.5, "param2": 2.5, "param3": 3.5, "param4": 4.5, "x": 47.125, "y": -8.5,
      "z": 20.25, "mission_type": 2},
     m.MissionItem(3, 191, 300, 3, 16, 1, 0, (1.5, 2.5, 3.5, 4.5), 47.125, -8.5, 20.25, 2,
                   floating=True)),
    ("REQUEST_DATA_STREAM",
     {**TARGET, "req_stream_id": 6, "req_message_rate": 4, "start_stop": 1},
     m.RequestDataStream(3, 191, 6, 4, True)),
    ("REQUEST_DATA_STREAM",
     {**TARGET, "req_stream_id": 6, "req_message_rate": 0, "start_stop": 0},
     m.RequestDataStream(3, 191, 6, 0, False)),
    ("FILE_TRANSFER_PROTOCOL",
     {"target_network": 0, **TARGET, "payload": [*range(1, 13)] + [0] * 239},
     m.FileTransfer(3, 191, bytes(range(1, 13)) + bytes(239))),
    ("NAMED_VALUE_FLOAT", {"time_boot_ms": 2003, "name": b"tick_p99", "value": 12.5},
     m.NamedValue(2.003, "tick_p99", 12.5)),
    ("NAMED_VALUE_INT", {"time_boot_ms": 2003, "name": b"ten_letter", "value": -4},
     m.NamedValue(2.003, "ten_letter", -4)),
    ("CAMERA_INFORMATION",
     {"time_boot_ms": 2003, "vendor_name": [*b"swarm", *bytes(27)],
      "model_name": [*b"forward", *bytes(25)], "firmware_version": 0, "focal_length": 2.125,
      "sensor_size_h": 3.5, "sensor_size_v": 2.75, "resolution_h": 640, "resolution_v": 400,
      "lens_id": 0, "flags": 3, "cam_definition_version": 0, "cam_definition_uri": b""},
     m.CameraInformation(2.003, "swarm", "forward", 2.125, 3.5, 2.75, 640, 400, 3)),
    ("ATTITUDE_QUATERNION",
     {"time_boot_ms": 2003, **{f"q{n}": q for n, q in enumerate(NED_OF_IT, 1)},
      "rollspeed": 0.125, "pitchspeed": -0.25, "yawspeed": 0.5},
     m.Attitude(2.003, NORTH_EAST_UP, np.array([0.125, 0.25, -0.5]))),
    ("ATTITUDE",  # pitch: arctan 0.75; yaw: 45° from north
     {"time_boot_ms": 2003, "roll": 0.0, "pitch": 0.6435011087932844, "yaw": 0.7853981633974483,
      "rollspeed": 0.125, "pitchspeed": -0.25, "yawspeed": 0.5},
     m.EulerAttitude(2.003, NORTH_EAST_UP, np.array([0.125, 0.25, -0.5]))),
    ("SET_ATTITUDE_TARGET",
     {"time_boot_ms": 2003, **TARGET, "type_mask": 7, "q": NED_OF_IT, "body_roll_rate": 0.125,
      "body_pitch_rate": -0.25, "body_yaw_rate": 0.5, "thrust": 0.375},
     m.RateSetpoint(2.003, np.array([0.125, 0.25, -0.5]), 0.375, 3, 191, 7, NORTH_EAST_UP)),
]  # fmt: skip

WRITTEN = [
    (
        "HIL_SENSOR",
        {"time_usec": 2000003, "xacc": 0.25, "yacc": -0.5, "zacc": -9.75, "xgyro": 0.125,
         "ygyro": 0.375, "zgyro": -0.625, "xmag": 0.1875, "ymag": -0.0625, "zmag": 0.4375,
         "abs_pressure": 955.5, "diff_pressure": 0.0, "pressure_alt": 430.5, "temperature": 25.0,
         "fields_updated": 8191},
        m.HilSensor(2.000003, np.array([0.25, 0.5, 9.75]), np.array([0.125, -0.375, 0.625]),
                    np.array([0.1875, 0.0625, -0.4375]), 955.5, 430.5),
    ),
    (
        "HIL_GPS",  # 3 m/s north, 4 m/s west: 307 degrees
        {"time_usec": 2000003, "fix_type": 3, "lat": 471234567, "lon": -85432101, "alt": 430517,
         "eph": 71, "epv": 113, "vel": 500, "vn": 300, "ve": -400, "vd": -50, "cog": 30687,
         "satellites_visible": 12},
        m.HilGps(2.000003, 47.1234567, -8.5432101, 430.517, np.array([-4.0, 3.0, 0.5]), 0.71, 1.13),
    ),
    (
        "HEARTBEAT",  # armed: 128 in the base mode
        {"type": 2, "autopilot": 12, "base_mode": 0xD1, "custom_mode": 0x04030000,
         "system_status": 4, "mavlink_version": 3},
        m.Heartbeat(12, 2, True, 0x04030000, 4, 0x51),
    ),
    (
        "SET_ATTITUDE_TARGET",  # without an attitude: no rotation; 1: of the autopilot, 128: rates
        {"time_boot_ms": 2003, "target_system": 3, "target_component": 1, "type_mask": 128,
         "q": [1.0, 0.0, 0.0, 0.0], "body_roll_rate": 0.125, "body_pitch_rate": -0.25,
         "body_yaw_rate": 0.5, "thrust": 0.375},
        m.RateSetpoint(2.003, np.array([0.125, 0.25, -0.5]), 0.375, 3),
    ),
    ("DISTANCE_SENSOR",  # 255: the variance is unknown
     {"time_boot_ms": 2003, "min_distance": 11, "max_distance": 1201, "current_distance": 155,
      "type": 1, "id": 0, "orientation": 25, "covariance": 255},
     m.DistanceSensor(2.003, 1.55, 0.11, 12.01, 25, 1)),
    ("REQUEST_DATA_STREAM",
     {**TARGET, "req_stream_id": 6, "req_message_rate": 3, "start_stop": 1},
     m.RequestDataStream(3, 191, 6, 2.6, True)),
    ("FILE_TRANSFER_PROTOCOL",
     {"target_network": 0, **TARGET, "payload": [1, 2] + [0] * 249},
     m.FileTransfer(3, 191, b"\1\2")),
]  # fmt: skip

READ = [
    (
        "HIL_ACTUATOR_CONTROLS",
        {"time_usec": 2000003, "controls": [n / 16 for n in range(16)], "mode": 0x81, "flags": 1},
        m.HilActuators(2.000003, tuple(n / 16 for n in range(16)), True),
    ),
    (
        "HIL_ACTUATOR_CONTROLS",
        {"time_usec": 2000003, "controls": [n / 16 for n in range(16)], "mode": 0x71, "flags": 0},
        m.HilActuators(2.000003, tuple(n / 16 for n in range(16)), False),
    ),
    (
        "HIL_STATE_QUATERNION",
        {"time_usec": 2000003, "attitude_quaternion": NED_OF_IT, "rollspeed": 0.125,
         "pitchspeed": -0.25, "yawspeed": 0.5, "lat": 471234567, "lon": -85432101, "alt": 430517,
         "vx": 150, "vy": -225, "vz": -312, "ind_airspeed": 1, "true_airspeed": 2, "xacc": 3,
         "yacc": 4, "zacc": 5},
        m.HilState(2.000003, NORTH_EAST_UP, np.array([0.125, 0.25, -0.5]), 47.1234567, -8.5432101,
                   430.517, np.array([-2.25, 1.5, 3.12])),
    ),
    ("DISTANCE_SENSOR",
     {"time_boot_ms": 2003, "min_distance": 11, "max_distance": 1201, "current_distance": 155,
      "type": 1, "id": 0, "orientation": 25, "covariance": 255},
     m.DistanceSensor(2.003, 1.55, 0.11, 12.01, 25, 1)),
    ("DISTANCE_SENSOR",
     {"time_boot_ms": 2003, "min_distance": 11, "max_distance": 1201, "current_distance": 155,
      "type": 1, "id": 0, "orientation": 25, "covariance": 254, "signal_quality": 1},
     m.DistanceSensor(2.003, 1.55, 0.11, 12.01, 25, 1, math.sqrt(254) / 100, 1)),
    *[
        (
            "COMMAND_INT",
            {**TARGET, "frame": frame, "command": 192, "current": 0, "autocontinue": 0,
             "param1": 1.5, "param2": 2.5, "param3": 3.5, "param4": 4.5, "x": 471234567,
             "y": -85432101, "z": 20.25},
            m.Command(192, (1.5, 2.5, 3.5, 4.5, *place, 20.25), 3, 191, frame=frame),
        )
        # MAV_FRAME: GLOBAL, …_RELATIVE_ALT, …_INT, …_RELATIVE_ALT_INT, …_TERRAIN_ALT(_INT) count in
        # 1e-7 degrees; LOCAL_NED, LOCAL_ENU and BODY_FRD in 0.1 mm.
        for frames, place in [
            ((0, 3, 5, 6, 10, 11), (47.1234567, -8.5432101)),
            ((1, 4, 12), (47123.4567, -8543.2101)),
        ]
        for frame in frames
    ],
]  # fmt: skip


def exactly(a, b):
    """Whether all fields are equal; quaternions and angles to a double's last digits or so."""
    if type(a) is not type(b):
        return False
    for name in a.__dataclass_fields__:
        x, y = getattr(a, name), getattr(b, name)
        if isinstance(x, np.ndarray):
            if np.shape(x) != np.shape(y) or not np.allclose(x, y, rtol=0, atol=2e-7):
                return False
        elif isinstance(x, float | tuple):
            if not np.allclose(x, y, rtol=1e-12, atol=0, equal_nan=True):
                return False
        elif x != y:
            return False
    return True


def ids(row):
    return row if isinstance(row, str) else ""


@pytest.mark.parametrize(("name", "fields", "message"), BOTH + WRITTEN, ids=ids)
def test_each_field_is_written_in_its_unit_and_frame(name, fields, message):
    assert shown(Codec(1, 1).encode([message])) == shown(written(name, fields))


@pytest.mark.parametrize(("name", "fields", "message"), BOTH + READ, ids=ids)
def test_each_field_is_read_in_its_unit_and_frame(name, fields, message):
    assert exactly(heard(name, fields), message), heard(name, fields)
