"""Lines of the journal: their form, and how many of them."""

import logging

import pytest

from companion.process import journal


def record(name, **fields):
    made = logging.LogRecord("companion", logging.WARNING, "", 0, name, None, None)
    made.fields = fields
    return made


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"phase": "fly"}, "<4>it phase=fly"),
        ({"text": 'two words, "quoted"'}, "<4>it text=\"two words, 'quoted'\""),
        ({"text": "line\nbreak"}, "<4>it text=line\\nbreak"),
        ({"t": 0.123456789}, "<4>it t=0.123457"),
        ({"text": ""}, '<4>it text=""'),
    ],
)
def test_a_log_line(fields, line):
    assert journal.Fields(prefix=True).format(record("it", **fields)) == line
    assert journal.Fields(prefix=False).format(record("it", **fields)) == line[3:]


def test_a_flood_is_counted_not_written():
    now = 0.0
    limit = journal.RateLimit(lambda: now)
    assert sum(limit.filter(record("flood")) for _ in range(1000)) == 5
    assert limit.filter(record("other"))
    now = 10.0
    after = record("flood")
    assert limit.filter(after)
    assert after.fields == {"suppressed": 995}
