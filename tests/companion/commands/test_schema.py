"""`companion schema`: every key of a drone's file."""

import json

from companion.__main__ import main
from companion.settings.config import CompanionConfig


def test_the_schema_describes_every_key(capsys):
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema["required"] == ["fileversion"]
    assert set(schema["properties"]) == set(CompanionConfig.model_fields)
    assert schema["$defs"]["LinkConfig"]["properties"]["system_id"]["maximum"] == 255
    assert schema["additionalProperties"] is False
