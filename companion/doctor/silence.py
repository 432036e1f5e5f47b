"""What the vehicle will do when the companion dies, from the autopilot's own parameters."""

from __future__ import annotations

from collections.abc import Callable

from companion.doctor.finding import Finding, Level, rated

Value = Callable[[str], float | None]  # a parameter by name; None: it was not sent

PARAMETERS = {
    "px4": ("COM_OF_LOSS_T", "COM_OBL_RC_ACT", "COM_RC_IN_MODE", "RTL_RETURN_ALT"),
    "ardupilot": ("GUID_TIMEOUT", "GUID_OPTIONS", "FS_GCS_ENABLE", "FS_OPTIONS"),
}
# Parameter of the time [s] that a vehicle flies on without setpoints, and its upper limit.
# ArduCopter goes on at the last rates and thrust: with its default, 3 s, it has struck the ground.
_TIMEOUTS = {"px4": ("COM_OF_LOSS_T", 1.0), "ardupilot": ("GUID_TIMEOUT", 0.5)}
_NO_STICKS = 4  # of COM_RC_IN_MODE: manual control is switched off
_RETURN, _LAND, _HOLD = 3, 4, 5  # of COM_OBL_RC_ACT; below 3 a pilot's sticks
_MODES = ("position", "altitude", "stabilised")
_GROUND_ACTIONS = {1: "returns", 2: "returns", 3: "returns", 4: "returns or lands", 5: "lands"}
_GROUND_ACTIONS |= {6: "returns", 7: "brakes or lands"}


def examine_silence(autopilot: str, value: Value, ceiling: float) -> list[Finding]:
    """Return how long the vehicle flies on without setpoints, and what it does then.

    ceiling: m above the take-off point, the fence's.
    """
    found = [_time(autopilot, value)]
    action = _px4(value, ceiling) if autopilot == "px4" else _ardupilot(value)
    return [*found, action]


def _time(autopilot: str, value: Value) -> Finding:
    name, most = _TIMEOUTS[autopilot]
    time = value(name)
    if time is None:
        return Finding(
            "silence", Level.AMBER, f"{name} was not sent", f"check that {name} ≤ {most:g}"
        )
    todo = f"set {name} to {most:g} or less: a vehicle whose companion died flies on for that long"
    return rated("silence", time, (most, 2 * most), f"{name} is {time:g} s", todo)


def _px4(value: Value, ceiling: float) -> Finding:
    """Examine PX4's offboard loss failsafe."""
    name, action = "COM_OBL_RC_ACT", value("COM_OBL_RC_ACT")
    if action is None:
        return _finding(Level.AMBER, f"{name} was not sent", f"check that {name} is 4 (land)")
    told = f"{name} is {action:g}: "
    if action == _LAND:
        return _finding(Level.GREEN, told + "it lands where it is")
    if action == _HOLD:
        todo = f"set {name} to 4 (land), unless a pilot stands by"
        return _finding(Level.AMBER, told + "it holds until a pilot or an empty battery ends", todo)
    if 0 <= action <= _RETURN:
        return _px4_return(told, int(action), value, ceiling)
    return _finding(Level.RED, told + "its motors stop, and it falls", f"set {name} to 4 (land)")


def _px4_return(told: str, action: int, value: Value, ceiling: float) -> Finding:
    """Examine a return, which also follows where sticks are missing to which it is to be given."""
    height = value("RTL_RETURN_ALT")
    shown = "RTL_RETURN_ALT" if height is None else f"{height:g} m"
    returns = f"it returns, at up to {shown} above home (RTL_RETURN_ALT)"
    if action < _RETURN:
        sticks = value("COM_RC_IN_MODE")
        why = "manual control is off (COM_RC_IN_MODE 4)" if sticks == _NO_STICKS else "without RC"
        returns = f"{_MODES[action]} mode for a pilot's sticks; {why} {returns}"
    over = height is not None and height > ceiling
    text = told + returns + (f", over the fence's {ceiling:g} m" if over else "")
    todo = "set COM_OBL_RC_ACT to 4 (land), or RTL_RETURN_ALT to a height that is free everywhere"
    return _finding(Level.RED if over else Level.AMBER, text, todo)


def _ardupilot(value: Value) -> Finding:
    """Examine what ArduCopter does in guided mode: it levels and stays there."""
    text = "it levels, holds its height and drifts with the wind, in guided mode until it is told"
    ground, options = value("FS_GCS_ENABLE"), value("FS_OPTIONS")
    if ground is None:
        text += "; FS_GCS_ENABLE was not sent"
    elif not ground:
        text += "; FS_GCS_ENABLE is 0: the loss of the ground station changes nothing"
    else:
        action = _GROUND_ACTIONS.get(int(ground), f"does action {ground:g}")
        text += f"; when the ground station is lost too, it {action} (FS_GCS_ENABLE {ground:g})"
    if options is not None and int(options) & 1 << 2:
        text += "; and it stays in guided mode where RC is lost (FS_OPTIONS bit 2)"
    todo = "a pilot or a ground station must stand by; FS_GCS_ENABLE 5 lands where both are lost"
    return _finding(Level.AMBER, text, todo)


def _finding(level: Level, text: str, todo: str = "") -> Finding:
    return Finding("companion dies", level, text, todo)
