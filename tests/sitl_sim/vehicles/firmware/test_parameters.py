"""The parameter protocol: names, types and values as they cross the wire."""

import math
import struct
from functools import partial

import pytest

from mavlink_bridge.wire.messages import ParamError, ParamRequestList, ParamRequestRead, ParamSet

REAL32, INT32 = 9, 6


NAN = math.nan


def as_float(value):
    return struct.unpack("<f", struct.pack("<i", value))[0]


def test_all_parameters_once_and_in_order(make_flight):
    f = make_flight()
    *values, hashed = f.send(ParamRequestList(1, 1))
    assert (hashed.name, hashed.param_type, hashed.index) == ("_HASH_CHECK", 5, 65535)
    assert [v.index for v in values] == list(range(len(values)))
    assert {v.count for v in values} == {len(values)}
    assert len({v.name for v in values}) == len(values)
    assert all(len(v.name) <= 16 for v in values)
    hover = next(v for v in values if v.name == "MPC_THR_HOVER")
    assert hover.value == pytest.approx(0.333, abs=1e-3)


def test_parameter_by_name_and_by_index(make_flight):
    f = make_flight()
    (by_name,) = f.send(ParamRequestRead(1, 1, "MIS_TAKEOFF_ALT", -1))
    (by_index,) = f.send(ParamRequestRead(1, 1, "", by_name.index))
    assert by_name == by_index
    assert by_name.value == 2.5
    assert f.send(ParamRequestRead(1, 1, "_HASH_CHECK", -1)) == f.send(ParamRequestList(1, 1))[-1:]


def test_px4_says_why_a_parameter_is_not_read_or_set(make_flight):
    """PX4 1.17: MAV_PARAM_ERROR 1 for no such parameter, 6 for a type it lacks, 7 for another."""
    f = make_flight()
    read, write = partial(ParamRequestRead, 1, 1), partial(ParamSet, 1, 1)
    assert f.send(read("NO_SUCH", -1)) == [ParamError(255, 190, "NO_SUCH", -1, 1)]
    assert f.send(read("", 9999)) == [ParamError(255, 190, "", 9999, 1)]
    assert f.send(write("NO_SUCH", 1.0, REAL32)) == [ParamError(255, 190, "NO_SUCH", -1, 1)]
    name = "COM_OBL_RC_ACT"
    assert f.send(write(name, 4.0, REAL32)) == [ParamError(255, 190, name, -1, 7)]
    assert f.send(write(name, 4.0, 2)) == [ParamError(255, 190, name, -1, 6)]
    assert f.autopilots.units[0].parameters[name] == 0.0


def test_ardupilot_takes_any_type_and_is_silent_about_unknown_names(make_flight):
    f = make_flight(flavour="ardupilot")
    (echo,) = f.send(ParamSet(1, 1, "GUID_OPTIONS", 8.0, REAL32))
    assert (echo.value, echo.param_type) == (8.0, INT32)
    assert f.send(ParamRequestRead(1, 1, "NO_SUCH", -1)) == []
    assert f.send(ParamSet(1, 1, "NO_SUCH", 1.0, REAL32)) == []


def test_set_parameter_is_echoed_and_used(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "MIS_TAKEOFF_ALT", 4.0, REAL32))
    assert (echo.name, echo.value) == ("MIS_TAKEOFF_ALT", 4.0)
    f.in_the_air()
    assert f.vehicles.p[0, 2] == pytest.approx(4.0, abs=0.3)


def test_int32_crosses_bytewise(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "COM_OBL_RC_ACT", as_float(3), INT32))
    assert echo.param_type == INT32
    assert struct.pack("<f", echo.value) == struct.pack("<i", 3)
    assert f.autopilots.units[0].parameters["COM_OBL_RC_ACT"] == 3.0


def test_px4_stores_nan_and_ardupilot_does_not(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "MIS_TAKEOFF_ALT", NAN, REAL32))
    assert math.isnan(echo.value)
    f.in_the_air()
    assert f.vehicles.p[0, 2] == pytest.approx(2.5, abs=0.3)  # flies by the default
    g = make_flight(flavour="ardupilot")
    assert g.send(ParamSet(1, 1, "PILOT_TKOFF_ALT", NAN, REAL32)) == []
    assert g.autopilots.units[0].parameters["PILOT_TKOFF_ALT"] == 250.0
