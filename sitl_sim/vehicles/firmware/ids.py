"""MAVLink numbers that the emulated autopilots use, by their names in the common dialect.

Numbers that both ends of the wire use are in `mavlink_bridge.wire.ids`.
Source: mavlink.io/en/messages/common.html.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

from mavlink_bridge.wire.ids import CommandId


class GroundCommand(IntEnum):
    """MAV_CMD values that only ground stations send."""

    MISSION_START = 300
    GET_HOME_POSITION = 410  # deprecated; MAVProxy sends it
    REQUEST_AUTOPILOT_CAPABILITIES = 520  # deprecated, still sent


class MissionCommand(IntEnum):
    """MAV_CMD values of mission items."""

    NAV_WAYPOINT = 16
    NAV_RETURN_TO_LAUNCH = CommandId.NAV_RETURN_TO_LAUNCH
    NAV_LAND = CommandId.NAV_LAND
    NAV_TAKEOFF = CommandId.NAV_TAKEOFF
    DO_CHANGE_SPEED = 178
    DO_DIGICAM_CONTROL = 203
    DO_MOUNT_CONTROL = 205
    DO_SET_CAM_TRIGG_DIST = 206
    SET_CAMERA_MODE = 530
    DO_GIMBAL_MANAGER_PITCHYAW = 1000
    IMAGE_START_CAPTURE = 2000
    IMAGE_STOP_CAPTURE = 2001
    VIDEO_START_CAPTURE = 2500
    VIDEO_STOP_CAPTURE = 2501


class MissionType(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2
    ALL = 255


class MissionResult(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    OPERATION_CANCELLED = 15


GLOBAL_INT_FRAME = 5  # MAV_FRAME_GLOBAL_INT
GLOBAL_FRAMES = (0, 3, 5, 6, 10, 11)  # MAV_FRAME: above the sea, above home, above the ground


class AltitudeFrame(IntEnum):
    """MAV_FRAME: those whose altitude counts from the sea."""

    GLOBAL = 0
    GLOBAL_INT = 5


class DataStream(IntEnum):
    """MAV_DATA_STREAM, the groups of REQUEST_DATA_STREAM."""

    ALL = 0
    RAW_SENSORS = 1
    EXTENDED_STATUS = 2
    POSITION = 6
    EXTRA1 = 10
    EXTRA2 = 11
    EXTRA3 = 12


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class Sensor(IntFlag):
    """MAV_SYS_STATUS_SENSOR."""

    GYRO = 0x1
    ACCEL = 0x2
    MAG = 0x4
    ABSOLUTE_PRESSURE = 0x8
    GPS = 0x20
    ANGULAR_RATE_CONTROL = 0x400
    ATTITUDE_STABILIZATION = 0x800
    YAW_POSITION = 0x1000
    Z_ALTITUDE_CONTROL = 0x2000
    XY_POSITION_CONTROL = 0x4000
    MOTOR_OUTPUTS = 0x8000
    GEOFENCE = 0x100000
    AHRS = 0x200000
    BATTERY = 0x2000000
    PREARM_CHECK = 0x10000000


class EstimatorFlag(IntFlag):
    """ESTIMATOR_STATUS_FLAGS."""

    ATTITUDE = 0x1
    VELOCITY_HORIZ = 0x2
    VELOCITY_VERT = 0x4
    POS_HORIZ_REL = 0x8
    POS_HORIZ_ABS = 0x10
    POS_VERT_ABS = 0x20
    PRED_POS_HORIZ_REL = 0x100
    PRED_POS_HORIZ_ABS = 0x200


class FtpOpcode(IntEnum):
    """Opcodes of the file transfer protocol (mavlink.io/en/services/ftp.html)."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_READ = 4
    READ_FILE = 5
    CALCULATE_CHECKSUM = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """Errors of the file transfer protocol."""

    INVALID_SESSION = 4
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_NOT_FOUND = 10
