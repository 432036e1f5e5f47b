"""Strict YAML: each mistake is reported with its place."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from mavlink_bridge.shared.settings import (
    Document,
    SettingsError,
    StrictModel,
    assignments,
    merge,
    parse_yaml,
    validate,
)


class Inner(StrictModel):
    rate_hz: float = 10.0
    on: bool = True


class Outer(StrictModel):
    name: str
    inner: Inner = Inner()
    sizes: list[int] = Field([])


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        ("name: a\ninner:\n  rate: 1\n", "f:3:3", "inner.rate: unknown key; did you mean"),
        ("name: a\ninner:\n  on: no\n", "f:3:3", "inner.on"),
        ("name: a\ninner:\n  rate_hz: 012\n", "f:3:3", "got '012'"),
        ("name: a\ninner:\n  rate_hz: .nan\n", "f:3:3", "got '.nan'"),
        ("name: a\nname: b\n", "f:2:1", "name: stands twice, first f:1:1"),
        ("inner: {}\n", "f:1:1", "name: is missing"),
        ("name: a\nsizes: [1, x]\n", "f:2:12", "sizes.1"),
        ("- 1\n", "f:1:1", "key: value"),
        ("name: [a\n", "f:2:1", "not YAML"),
        ("name: 5\n", "f:1:1", "name: must be text, in quotes"),
    ],
)
def test_a_mistake_is_reported_with_its_place(text, where, what):
    with pytest.raises(SettingsError) as caught:
        validate(Outer, parse_yaml(text, "f"), "f")
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(f"{where}: ")
    assert what in caught.value.problems[0]


def test_all_mistakes_are_reported_at_once():
    with pytest.raises(SettingsError) as caught:
        validate(Outer, parse_yaml("nam: a\ninner: {on: 1, rate_hz: x}\n", "f"), "f")
    assert len(caught.value.problems) == 4


def test_later_layers_override_earlier_ones():
    base = parse_yaml("name: a\ninner: {rate_hz: 5, on: false}\nsizes: [1, 2]\n", "base")
    top = parse_yaml("inner: {rate_hz: 7}\n", "top")
    merged = merge([base, top, assignments(["sizes=[3]"])])
    outer = validate(Outer, merged, "base")
    assert outer == Outer(name="a", inner=Inner(rate_hz=7.0, on=False), sizes=[3])
    assert merged.places[("inner", "rate_hz")].startswith("top:")
    with pytest.raises(SettingsError, match=r"--set sizes=3: sizes: "):
        validate(Outer, merge([base, assignments(["sizes=3"])]), "base")
    with pytest.raises(SettingsError, match=r"must be path\.to\.key=value"):
        assignments(["sizes"])


@pytest.mark.parametrize("value", ["{rate_hz: 1, rate_hz: 2}", "{on: true,\n on: true}"])
def test_a_duplicate_key_in_an_assignment_is_reported(value):
    with pytest.raises(SettingsError) as caught:
        validate(Outer, merge([parse_yaml("name: a\n", "f"), assignments([f"inner={value}"])]), "f")
    assert len(caught.value.problems) == 1
    assert caught.value.problems[0].startswith(f"--set inner={value}: inner.")
    assert "stands twice" in caught.value.problems[0]


def test_an_assignment_is_one_value():
    with pytest.raises(SettingsError, match=r"must be path\.to\.key=value"):
        assignments(["name=a\ninner: {}"])


@pytest.mark.parametrize("text", ["a:\n", "a: ~\n", "a: null\n", "{a: , b: 1}\n"])
def test_no_value_is_null(text):
    assert parse_yaml(text, "f").data["a"] is None
    assert parse_yaml("a: ''\n", "f").data["a"] == ""


def test_mistakes_in_data_without_places_are_reported():
    with pytest.raises(SettingsError, match=r"^f: inner\.rate: unknown key; did you mean"):
        validate(Outer, Document({"name": "a", "inner": {"rate": 1}}), "f")


@given(st.text(st.sampled_from("abN:-[]{}!&*?|>#%@,'\"\\ \t\n0.1e+~_"), max_size=60))
def test_any_text_gives_a_document_or_errors_with_their_place(text):
    problems = []
    try:
        problems += parse_yaml(text, "f").problems
    except SettingsError as error:
        problems += error.problems
    assert all(p.startswith("f:") for p in problems)
