"""Answers of one vehicle to each message: commands, modes, parameters, missions, streams."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mavlink_bridge.wire.ids import ComponentId, MessageId, ModeFlag, Severity
from mavlink_bridge.wire.messages import (
    Command,
    CommandAck,
    CommandId,
    CommandResult,
    FileTransfer,
    Message,
    MissionClearAll,
    MissionCount,
    MissionItem,
    MissionRequest,
    MissionRequestList,
    MissionSetCurrent,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Ping,
    RateSetpoint,
    Received,
    RequestDataStream,
    SetMode,
    Source,
    TimeSync,
)
from sitl_sim.vehicles.firmware.files import answer_file_request
from sitl_sim.vehicles.firmware.flavour import Mode
from sitl_sim.vehicles.firmware.ids import GLOBAL_INT_FRAME, DataStream, GroundCommand
from sitl_sim.vehicles.firmware.streams import BUILDERS

if TYPE_CHECKING:
    from sitl_sim.vehicles.firmware.unit import Unit

FORCE = 21196.0  # param2 of arm and disarm: without checks
GROUPS: dict[int, tuple[MessageId, ...]] = {
    DataStream.RAW_SENSORS: (MessageId.GPS_RAW_INT,),
    DataStream.EXTENDED_STATUS: (
        MessageId.SYS_STATUS,
        MessageId.MISSION_CURRENT,
        MessageId.EXTENDED_SYS_STATE,
    ),
    DataStream.POSITION: (MessageId.LOCAL_POSITION_NED, MessageId.GLOBAL_POSITION_INT),
    DataStream.EXTRA1: (MessageId.ATTITUDE, MessageId.ATTITUDE_QUATERNION),
    DataStream.EXTRA2: (MessageId.BATTERY_STATUS,),
    DataStream.EXTRA3: (MessageId.SYSTEM_TIME, MessageId.ESTIMATOR_STATUS),
}
"""Messages of each group of REQUEST_DATA_STREAM."""
MISSION_MESSAGES = (
    MissionCount,
    MissionItem,
    MissionRequest,
    MissionRequestList,
    MissionClearAll,
    MissionSetCurrent,
)


def answer(u: Unit, received: Received, link: str) -> list[Message]:
    """Let vehicle u take a message that came by `link`; return the replies for that link."""
    m, source = received.message, received.source
    if source.system == u.system:
        u.components[link].add(source.component)
    if u.flavour.sticks or not _is_for(u, m, link):
        return []
    u.hear(m, link)
    if isinstance(m, RateSetpoint):
        u.commander.follow(m)
        return []
    if isinstance(m, Command):
        return _command(u, source, m, link)
    if isinstance(m, SetMode):
        _set_mode(u, m.custom_mode)
        return []
    if isinstance(m, MISSION_MESSAGES):
        return u.missions.answer(source, m, link, u.boot_us)
    if isinstance(m, ParamRequestList | ParamRequestRead | ParamSet):
        return _parameters(u, source, m)
    if isinstance(m, Ping):
        asked = m.target_system == 0 and u.flavour.answers_pings
        return [Ping(m.time, m.sequence, source.system, source.component)] if asked else []
    if isinstance(m, TimeSync):
        if m.tc1 != 0:
            return []
        return [TimeSync(u.boot_ns, m.ts1)]
    if isinstance(m, RequestDataStream):
        _data_stream(u, m, link)
        return []
    if isinstance(m, FileTransfer):
        return list(answer_file_request(source, m))
    return []


def _is_for(u: Unit, m: Message, link: str) -> bool:
    system = getattr(m, "target_system", 0)
    component = getattr(m, "target_component", 0)
    if component not in (0, ComponentId.AUTOPILOT1):
        elsewhere = any(component in c for other, c in u.components.items() if other != link)
        return u.flavour.stands_in and system == u.system and not elsewhere
    return system in (0, u.system)


def _command(u: Unit, source: Source, m: Command, link: str) -> list[Message]:
    def ack(result: int) -> Message:
        return CommandAck(m.command, int(result), source.system, source.component)

    if m.command in u.flavour.nan_ends and any(map(math.isnan, m.params)):
        return []
    if u.flavour.global_frame_only and m.frame not in (None, GLOBAL_INT_FRAME):
        return [ack(CommandResult.COMMAND_UNSUPPORTED_MAV_FRAME)]
    handler = COMMANDS.get(m.command)
    if handler is None:
        return [ack(CommandResult.UNSUPPORTED)]
    result, replies = handler(u, m, link)
    if m.command == CommandId.DO_SET_MODE and u.flavour.split_mode:
        # PX4 acknowledges its arrival, and then what came of it.
        replies = [ack(result), *replies]
        result = CommandResult.ACCEPTED
    return [ack(result), *replies]


Handled = tuple[int, list[Message]]


def _arm(u: Unit, m: Command, link: str) -> Handled:
    wanted, force = m.params[0], m.params[1] == FORCE
    if wanted not in (0.0, 1.0):
        return u.flavour.arm_unknown, []
    return (u.commander.arm(force) if wanted else u.commander.disarm(force)), []


def _run_checks(u: Unit, m: Command, link: str) -> Handled:
    return u.commander.run_checks(), []


def _take_off(u: Unit, m: Command, link: str) -> Handled:
    """Answer NAV_TAKEOFF: altitude above sea level (PX4) or above home (ArduPilot)."""
    z = m.params[6]
    if not math.isfinite(z):
        return u.commander.take_off(None), []
    if u.flavour.takeoff_above_sea:
        # PX4 takes an altitude that is too low as its smallest height.
        z = max(z - u.frame.to_geo(u.guidance.est.p[u.i])[2], u.commander.settings.takeoff_altitude)
    refused = CommandResult.DENIED if u.flavour.takeoff_mode else CommandResult.FAILED
    return (u.commander.take_off(z) if z > 0.0 else refused), []


def _land(u: Unit, m: Command, link: str) -> Handled:
    return u.commander.set_mode(Mode.LAND), []


def _return(u: Unit, m: Command, link: str) -> Handled:
    return u.commander.set_mode(Mode.RETURN), []


def _start_mission(u: Unit, m: Command, link: str) -> Handled:
    if math.isfinite(m.params[0]) and 0 <= int(m.params[0]) < len(u.guidance.mission):
        u.guidance.mission_seq = int(m.params[0])
    return u.commander.set_mode(Mode.MISSION), []


def _do_set_mode(u: Unit, m: Command, link: str) -> Handled:
    if not u.flavour.split_mode and not int(m.params[0]) & ModeFlag.CUSTOM_MODE_ENABLED:
        return CommandResult.DENIED, []
    main, sub = (int(p) if math.isfinite(p) else 0 for p in m.params[1:3])
    return _set_mode(u, main << 16 | sub << 24 if u.flavour.split_mode else main), []


def _set_mode(u: Unit, custom_mode: int) -> int:
    mode = u.flavour.mode_of(custom_mode)
    if mode is None:
        return u.commander.refuse_mode(custom_mode)
    u.asked_mode = custom_mode
    return u.commander.set_mode(mode)


def _set_message_interval(u: Unit, m: Command, link: str) -> Handled:
    if not all(map(math.isfinite, m.params[:2])):
        return CommandResult.DENIED, []
    message_id, interval_us = int(m.params[0]), m.params[1]
    if message_id in u.flavour.unsent:
        return CommandResult.ACCEPTED, []
    if message_id not in BUILDERS or message_id in u.flavour.lacks:
        if u.flavour.reports_events:
            return CommandResult.FAILED, []
        u.commander.say(Severity.INFO, f"No ap_message for mavlink id ({message_id})")
        return CommandResult.DENIED, []
    if interval_us == 0.0:  # back to the default
        rate_hz = u.flavour.streams[link].get(message_id, 0.0)
    else:
        rate_hz = 1e6 / interval_us if interval_us > 0.0 else 0.0
    u.schedules[link].set_rate(message_id, rate_hz)
    return CommandResult.ACCEPTED, []


def _request_message(u: Unit, m: Command, link: str) -> Handled:
    number = int(m.params[0]) if math.isfinite(m.params[0]) else -1
    builder = None if number in u.flavour.lacks else BUILDERS.get(number)
    if builder and number in u.flavour.fresh_only:
        return CommandResult.DENIED, []  # the stream sends it soon enough
    message = builder(u) if builder else None
    if message is None:
        return CommandResult.DENIED if u.flavour.reports_events else CommandResult.FAILED, []
    return CommandResult.ACCEPTED, [message]


def _get_home(u: Unit, m: Command, link: str) -> Handled:
    message = BUILDERS[MessageId.HOME_POSITION](u)
    return CommandResult.ACCEPTED, [message] if message else []


def _request_version(u: Unit, m: Command, link: str) -> Handled:
    message = BUILDERS[MessageId.AUTOPILOT_VERSION](u)
    return CommandResult.ACCEPTED, [message] if message else []


COMMANDS: dict[int, Callable[[Unit, Command, str], Handled]] = {
    CommandId.NAV_RETURN_TO_LAUNCH: _return,
    CommandId.NAV_LAND: _land,
    CommandId.NAV_TAKEOFF: _take_off,
    CommandId.DO_SET_MODE: _do_set_mode,
    GroundCommand.MISSION_START: _start_mission,
    CommandId.COMPONENT_ARM_DISARM: _arm,
    CommandId.RUN_PREARM_CHECKS: _run_checks,
    CommandId.SET_MESSAGE_INTERVAL: _set_message_interval,
    CommandId.REQUEST_MESSAGE: _request_message,
    GroundCommand.GET_HOME_POSITION: _get_home,
    GroundCommand.REQUEST_AUTOPILOT_CAPABILITIES: _request_version,
}


def _parameters(
    u: Unit, source: Source, m: ParamRequestList | ParamRequestRead | ParamSet
) -> list[Message]:
    if isinstance(m, ParamRequestList):
        return list(u.parameters.all())
    to = (source.system, source.component)
    if isinstance(m, ParamRequestRead):
        return list(u.parameters.read(m, to))
    replies = u.parameters.write(m, to)
    u.configure()
    return list(replies)


def _data_stream(u: Unit, m: RequestDataStream, link: str) -> None:
    rate_hz = m.rate_hz if m.start else 0.0
    groups = GROUPS.values() if m.stream == DataStream.ALL else [GROUPS.get(m.stream, ())]
    for ids in groups:
        for message_id in ids:
            u.schedules[link].set_rate(message_id, rate_hz)
