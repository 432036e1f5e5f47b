"""Files and logs in the keys of fileversion 1."""

import copy

import pytest

from companion.settings.config import FILEVERSION, CompanionConfig, load_config
from companion.settings.renamed import REMOVED, RENAMED, upgraded
from mavlink_bridge.shared.settings import SettingsError

OLD = {
    "fileversion": 1,
    "name": "old",
    "eye": {"late": 0.2},
    "reciprocity": {"share": 0.3},
    "threat": {"d_ref": 1.5, "room": 1.3, "calm": 0.9, "critical": 2},
    "gaze": {"seen_full": 0.6, "creep": 0.2, "sigma": 0.3},
}


def known(path):
    """Whether a key, or a section, of this dotted path is in the schema."""
    model = CompanionConfig
    for key in path.split("."):
        field = getattr(model, "model_fields", {}).get(key)
        if field is None:
            return False
        model = field.annotation
    return True


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_each_new_key_is_in_the_schema_and_no_old_one(old, new):
    assert known(new)
    assert not known(old)


@pytest.mark.parametrize("gone", REMOVED)
def test_no_removed_key_is_in_the_schema(gone):
    assert not known(gone)


def test_a_file_is_told_the_new_key_at_the_place_of_the_old(tmp_path):
    file = tmp_path / "old.yaml"
    file.write_text(
        "fileversion: 2\nname: old\neye: {late: 0.2}\nthreat:\n  room: 1.3\n  critical: 2\n"
    )
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    assert sorted(caught.value.problems) == [
        f"{file}:3:1: eye: was renamed to camera_health",
        f"{file}:5:3: threat.room: was renamed to speed_limits.clearance",
    ]


def test_a_file_of_version_1_is_told_its_version_and_the_new_keys(tmp_path):
    file = tmp_path / "old.yaml"
    file.write_text("fileversion: 1\nname: old\ngaze: {seen_none: 1.2}\n")
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    assert caught.value.problems == [
        f"{file}:1:1: fileversion: must be {FILEVERSION}, got 1",
        f"{file}:3:8: gaze.seen_none: was renamed to speed_limits.no_view",
    ]


def test_a_removed_key_is_not_to_be_moved(tmp_path):
    """Moved to nmpc.d_ref, the old value would change the flight."""
    file = tmp_path / "old.yaml"
    file.write_text("fileversion: 2\nthreat: {d_ref: 1.5}\n")
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    (problem,) = caught.value.problems
    assert problem.startswith(f"{file}:2:10: threat.d_ref: was removed: nmpc.d_ref serves both")


def test_a_rule_that_is_gone_is_told_by_its_section_or_its_key(tmp_path):
    file = tmp_path / "old.yaml"
    file.write_text("fileversion: 2\nreciprocity: {share: 0.3, most: 1.0}\nthreat: {d_ref: 0.9}\n")
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    section, key = sorted(caught.value.problems)
    assert section.startswith(f"{file}:2:1: reciprocity: was removed: neighbours are expected")
    assert key.startswith(f"{file}:3:10: threat.d_ref: was removed: nmpc.d_ref")


def test_a_count_of_looks_is_told_what_has_taken_its_place(tmp_path):
    file = tmp_path / "old.yaml"
    file.write_text("fileversion: 2\ntracker: {hits_to_confirm: 3, misses_to_drop: 4}\n")
    with pytest.raises(SettingsError) as caught:
        load_config(file)
    first, second = caught.value.problems
    assert first.startswith(f"{file}:2:11: tracker.hits_to_confirm: was removed: tracker.detected")
    assert second.startswith(f"{file}:2:31: tracker.misses_to_drop: was removed: tracker.detected")


def test_a_log_of_version_1_is_read_in_the_new_keys():
    before = copy.deepcopy(OLD)
    config = CompanionConfig.model_validate(upgraded(OLD, FILEVERSION))
    assert before == OLD
    assert config.camera_health.late == 0.2
    assert config.speed_limits.clearance == 1.3
    assert (config.speed_limits.full_view, config.speed_limits.no_view_share) == (0.6, 0.2)
    assert (config.threat.critical, config.gaze.sigma) == (2, 0.3)
    assert config.nmpc.d_ref == CompanionConfig().nmpc.d_ref  # of the two, the solver's counts


def test_what_is_new_stays_as_it_is():
    new = {"fileversion": FILEVERSION, "speed_limits": {"clearance": 1.3}}
    assert upgraded(new, FILEVERSION) == new
