"""The frozen records that pass between packages, by who makes them.

Frames: NED, depth z positive down; psi is the heading, clockwise from north. DOF order is always
x, y, z, psi (inertial) or surge, sway, heave, yaw (body, Fossen's X, Y, Z, N). SI units and radians.
Times: `t_s` is this machine's monotonic clock, `boot_s` the autopilot's clock.
"""

from companion.records.control import NEUTRAL, AxisCommand, DofSample, Wrench
from companion.records.dof import AXES, DOFS, PSI, ZERO, Array, Flags, Vector, X, Y, Z
from companion.records.events import (
    Attitude,
    Battery,
    CommandAck,
    Depth,
    DepthRate,
    EkfOrigin,
    EkfStatus,
    Event,
    Firmware,
    Heartbeat,
    Leak,
    LinkCounters,
    Parameter,
    PilotGain,
    PilotHeartbeat,
    PilotInput,
    PilotSticks,
    PilotToggle,
    Position,
    Reboot,
    ReceiverChannels,
    Sender,
    ServoOutput,
    StatusText,
    TimeSync,
)
from companion.records.operator import ENGAGE_S, Request, Setpoint
from companion.records.sample import ControlSample, LoopHealth
from companion.records.state import Ages, Delays, FrameShift, VehicleState
from companion.records.supervision import Condition, State, Verdict

__all__ = [
    "AXES",
    "DOFS",
    "ENGAGE_S",
    "NEUTRAL",
    "PSI",
    "ZERO",
    "Ages",
    "Array",
    "Attitude",
    "AxisCommand",
    "Battery",
    "CommandAck",
    "Condition",
    "ControlSample",
    "Delays",
    "Depth",
    "DepthRate",
    "DofSample",
    "EkfOrigin",
    "EkfStatus",
    "Event",
    "Firmware",
    "Flags",
    "FrameShift",
    "Heartbeat",
    "Leak",
    "LinkCounters",
    "LoopHealth",
    "Parameter",
    "PilotGain",
    "PilotHeartbeat",
    "PilotInput",
    "PilotSticks",
    "PilotToggle",
    "Position",
    "Reboot",
    "ReceiverChannels",
    "Request",
    "Sender",
    "ServoOutput",
    "Setpoint",
    "State",
    "StatusText",
    "TimeSync",
    "Vector",
    "VehicleState",
    "Verdict",
    "Wrench",
    "X",
    "Y",
    "Z",
]
