"""The parameter protocol: names, types and values as they cross the wire."""

import math
import struct

import pytest

from mavlink_bridge.wire.messages import ParamRequestList, ParamRequestRead, ParamSet

REAL32, INT32 = 9, 6


NAN = math.nan


def as_float(value):
    return struct.unpack("<f", struct.pack("<i", value))[0]


def test_all_parameters_once_and_in_order(make_flight):
    f = make_flight()
    values = f.send(ParamRequestList(1, 1))
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
    assert f.send(ParamRequestRead(1, 1, "NO_SUCH", -1)) == []
    assert f.send(ParamRequestRead(1, 1, "", 9999)) == []


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


def test_nan_changes_nothing(make_flight):
    f = make_flight()
    (echo,) = f.send(ParamSet(1, 1, "MIS_TAKEOFF_ALT", NAN, REAL32))
    assert echo.value == 2.5
