"""The frozen records that pass between packages, by who makes them.

Frames: NED, depth z positive down; psi is the heading, clockwise from north. DOF order is always
x, y, z, psi (inertial) or surge, sway, heave, yaw (body, Fossen's X, Y, Z, N). SI units and radians.
Times: `t_s` is this machine's monotonic clock, `boot_s` the autopilot's clock.
"""

from companion.records.conditions import Condition
from companion.records.control import NEUTRAL, Axes, AxisCommand, Dofs, DofSample
from companion.records.dof import (
    AXES,
    DOFS,
    LEVEL,
    PSI,
    ZERO,
    Angles,
    Flags,
    Vector,
    X,
    Y,
    Z,
    chosen,
    either,
    vector,
    without,
)
from companion.records.events import (
    SAMPLES,
    Attitude,
    AttitudeTarget,
    Battery,
    Depth,
    DepthRate,
    DepthSensor,
    EkfOrigin,
    EkfStatus,
    Event,
    FirmwareVersion,
    GlobalOrigin,
    Heartbeat,
    Leak,
    LinkCounters,
    OtherHoldfast,
    Parameter,
    PilotAction,
    PilotCommand,
    PilotGain,
    PilotHeartbeat,
    PilotInput,
    PilotSticks,
    PilotToggle,
    Position,
    PositionTarget,
    Pressure,
    Range,
    Reboot,
    ReceiverChannels,
    Refused,
    Sender,
    ServoOutput,
    StatusText,
    TimeSync,
)
from companion.records.state import (
    Ages,
    Current,
    Delays,
    FrameShift,
    Ground,
    HeadingCheck,
    VehicleModel,
    VehicleState,
)
from companion.records.tick_record import (
    ENGAGE_S,
    ControlSample,
    DiveTotals,
    Guided,
    LoopHealth,
    Request,
    Setpoint,
    State,
    Verdict,
)
