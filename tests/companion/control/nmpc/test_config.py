"""Invalid numbers are refused by the key's name."""

import math

import pytest
from pydantic import ValidationError

from companion.control.nmpc import NmpcConfig


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("M", 21),
        ("M_constraint", 21),
        ("N", 1),
        ("dt", 0.0),
        ("c_min", -1.0),
        ("c_min", 12.0),
        ("c_max", 9.0),
        ("omega_max", -3.0),
        ("delta_c_max", 0.0),
        ("w_mig", -1.0),
        ("w_yaw", math.nan),
        ("d_agent_safety", -0.8),
        ("d_ref", 0.5),
        ("v_max", 1.0),
        ("penalty", math.inf),
        ("neighbours", -1),
        ("sqp_iterations_max", 1),
        ("wmig", 1.0),
    ],
)
def test_an_invalid_number_is_refused_by_its_key(key, value):
    with pytest.raises(ValidationError, match=key):
        NmpcConfig(**{key: value})


def test_every_field_has_a_description():
    for name, field in NmpcConfig.model_fields.items():
        assert field.description, name
        assert len(field.description) > 10, name
