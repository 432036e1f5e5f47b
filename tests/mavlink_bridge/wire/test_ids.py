"""Numbers of MAVLink against the published dialect."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink  # holds the common dialect

from mavlink_bridge.wire import ids

PREFIXES = {
    ids.MessageId: "MAVLINK_MSG_ID_",
    ids.CommandId: "MAV_CMD_",
    ids.CommandResult: "MAV_RESULT_",
    ids.AutopilotId: "MAV_AUTOPILOT_",
    ids.ComponentId: "MAV_COMP_ID_",
    ids.VehicleType: "MAV_TYPE_",
    ids.SystemState: "MAV_STATE_",
    ids.ModeFlag: "MAV_MODE_FLAG_",
    ids.Severity: "MAV_SEVERITY_",
    ids.ParameterType: "MAV_PARAM_TYPE_",
    ids.ParameterError: "MAV_PARAM_ERROR_",
    ids.GpsFix: "GPS_FIX_TYPE_",
    ids.EstimatorType: "MAV_ESTIMATOR_TYPE_",
    ids.DistanceSensorType: "MAV_DISTANCE_SENSOR_",
    ids.SensorRotation: "MAV_SENSOR_ROTATION_",
    ids.AttitudeTargetMask: "ATTITUDE_TARGET_TYPEMASK_",
    ids.Capability: "MAV_PROTOCOL_CAPABILITY_",
}
RENAMED = {
    "FIX_3D": "3D_FIX",  # no Python name begins with a digit
    "DOWN": "PITCH_270",
}
# In https://mavlink.io/en/messages/common.html and not yet in pymavlink's dialect.
NEWER = {
    "MAVLINK_MSG_ID_COMPONENT_INFORMATION_BASIC": 396,
    "MAV_PARAM_ERROR_TYPE_UNSUPPORTED": 6,
    "MAV_PARAM_ERROR_TYPE_MISMATCH": 7,
    "MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME": 9,
}


@pytest.mark.parametrize("table", PREFIXES, ids=lambda table: table.__name__)
def test_every_number_is_that_of_the_dialect(table):
    for member in table:
        name = PREFIXES[table] + RENAMED.get(member.name, member.name)
        assert member.value == getattr(mavlink, name, NEWER.get(name)), name


def test_every_table_is_compared():
    tables = {t for t in vars(ids).values() if isinstance(t, type) and t.__module__ == ids.__name__}
    assert tables == set(PREFIXES)
