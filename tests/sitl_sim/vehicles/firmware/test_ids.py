"""The numbers of the emulated autopilots are those of the dialect."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl_sim.vehicles.firmware import ids

PREFIXES = {
    ids.GroundCommand: "MAV_CMD_",
    ids.MissionCommand: "MAV_CMD_",
    ids.MissionType: "MAV_MISSION_TYPE_",
    ids.MissionResult: "MAV_MISSION_",
    ids.AltitudeFrame: "MAV_FRAME_",
    ids.DataStream: "MAV_DATA_STREAM_",
    ids.LandedState: "MAV_LANDED_STATE_",
    ids.Sensor: "MAV_SYS_STATUS_",
    ids.EstimatorFlag: "ESTIMATOR_",
}
OTHER_NAMES = {  # those that the dialect begins with a digit, or spells in another place
    "GYRO": "SENSOR_3D_GYRO",
    "ACCEL": "SENSOR_3D_ACCEL",
    "MAG": "SENSOR_3D_MAG",
}


@pytest.mark.parametrize("table", PREFIXES, ids=lambda table: table.__name__)
def test_every_number_is_that_of_its_name(table):
    for member in table:
        name = OTHER_NAMES.get(member.name, member.name)
        found = [
            getattr(dialect, PREFIXES[table] + infix + name, None) for infix in ("", "SENSOR_")
        ]
        assert member.value in found, member
