"""MAVLink's numbers by name, as far as this project sends or reads them.

Source: https://mavlink.io/en/messages/common.html. A test compares every member with pymavlink.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class MessageId(IntEnum):
    """Messages that are requested or sent as a stream."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    SYSTEM_TIME = 2
    PING = 4
    GPS_RAW_INT = 24
    ATTITUDE = 30
    ATTITUDE_QUATERNION = 31
    LOCAL_POSITION_NED = 32
    GLOBAL_POSITION_INT = 33
    MISSION_CURRENT = 42
    ATTITUDE_TARGET = 83
    HIGHRES_IMU = 105
    TIMESYNC = 111
    HIL_STATE_QUATERNION = 115
    DISTANCE_SENSOR = 132
    BATTERY_STATUS = 147
    AUTOPILOT_VERSION = 148
    EKF_STATUS_REPORT = 193  # ArduPilot's own
    ESTIMATOR_STATUS = 230
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245
    NAMED_VALUE_FLOAT = 251
    NAMED_VALUE_INT = 252
    CAMERA_INFORMATION = 259
    ODOMETRY = 331
    COMPONENT_INFORMATION_BASIC = 396


class CommandId(IntEnum):
    """MAV_CMD: commands that this project sends or answers."""

    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    DO_SET_MODE = 176
    DO_PAUSE_CONTINUE = 193
    COMPONENT_ARM_DISARM = 400
    RUN_PREARM_CHECKS = 401
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


class CommandResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    COMMAND_UNSUPPORTED_MAV_FRAME = 9


class AutopilotId(IntEnum):
    """MAV_AUTOPILOT: firmware of a vehicle; INVALID for a component that is no autopilot."""

    GENERIC = 0
    ARDUPILOTMEGA = 3
    INVALID = 8
    PX4 = 12


class ComponentId(IntEnum):
    """MAV_COMP_ID: components of one system."""

    AUTOPILOT1 = 1
    ONBOARD_COMPUTER = 191


class VehicleType(IntEnum):
    """MAV_TYPE."""

    QUADROTOR = 2
    GCS = 6
    ONBOARD_CONTROLLER = 18


class SystemState(IntEnum):
    """MAV_STATE, the system_status of a HEARTBEAT."""

    UNINIT = 0
    BOOT = 1
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5


class ModeFlag(IntFlag):
    """MAV_MODE_FLAG: bits of the base_mode of a HEARTBEAT."""

    CUSTOM_MODE_ENABLED = 1
    AUTO_ENABLED = 4
    GUIDED_ENABLED = 8
    STABILIZE_ENABLED = 16
    MANUAL_INPUT_ENABLED = 64
    SAFETY_ARMED = 128


class Severity(IntEnum):
    """MAV_SEVERITY of a STATUSTEXT, as in syslog."""

    EMERGENCY = 0
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    INFO = 6


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE."""

    INT8 = 2
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    REAL32 = 9


class ParameterError(IntEnum):
    """MAV_PARAM_ERROR of a PARAM_ERROR; the last is newer than the generated dialect."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    PERMISSION_DENIED = 3
    COMPONENT_NOT_FOUND = 4
    READ_ONLY = 5
    TYPE_UNSUPPORTED = 6
    TYPE_MISMATCH = 7


class GpsFix(IntEnum):
    """GPS_FIX_TYPE; FIX_3D is 3D_FIX there."""

    NO_GPS = 0
    NO_FIX = 1
    FIX_3D = 3
    RTK_FLOAT = 5
    RTK_FIXED = 6


class EstimatorType(IntEnum):
    """MAV_ESTIMATOR_TYPE: the estimator of an ODOMETRY."""

    UNKNOWN = 0
    VIO = 3
    AUTOPILOT = 8


class DistanceSensorType(IntEnum):
    """MAV_DISTANCE_SENSOR."""

    LASER = 0


class SensorRotation(IntEnum):
    """MAV_SENSOR_ORIENTATION (names begin with MAV_SENSOR_ROTATION); DOWN is PITCH_270 there."""

    DOWN = 25


class AttitudeTargetMask(IntFlag):
    """ATTITUDE_TARGET_TYPEMASK: fields of SET_ATTITUDE_TARGET that the autopilot ignores."""

    BODY_ROLL_RATE_IGNORE = 1
    BODY_PITCH_RATE_IGNORE = 2
    BODY_YAW_RATE_IGNORE = 4
    THROTTLE_IGNORE = 64
    ATTITUDE_IGNORE = 128


class Capability(IntFlag):
    """MAV_PROTOCOL_CAPABILITY: bits of AUTOPILOT_VERSION."""

    MISSION_FLOAT = 0x1
    PARAM_FLOAT = 0x2
    MISSION_INT = 0x4
    COMMAND_INT = 0x8
    PARAM_ENCODE_BYTEWISE = 0x10
    SET_ATTITUDE_TARGET = 0x40
    MAVLINK2 = 0x2000
    PARAM_ENCODE_C_CAST = 0x20000
