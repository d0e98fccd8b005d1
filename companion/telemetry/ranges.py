"""What each quantity that a user may set can meaningfully be.

One table for the configuration's file, `--set`, the command line, live commands and the dashboard.
A range ends where a value says nothing of a vehicle that these thrusters can hold: it takes in what is
shipped, what `holdfast lab tune` searches and the published BlueROV2 models with room to spare, and leaves
out what switches a protection off. Where 0 means that there is none, `least` is the least beside it: a number
nearly 0 is a mistake in its unit, and what divides by it may be infinite. Units are m, N and kg; on the yaw
axis rad, N·m and kg·m².
"""

from typing import Annotated

from msgspec import Meta

# The nominal model of an axis, in newtons of a T200: vehicles that exist, and room beyond. The lightest: 3
# kg with 1.5 kg of water and thrusters three times as strong (T500) count as 1.5 kg. The heaviest: a work-
# class vehicle of 5 t with as much water and 9 kN (assumed), in place of the 130 N of four T200, counts as
# 150 kg. Damping: a BlueROV2 Heavy has up to 217 N s2/m2 (docs/ardusub.md, "Vehicles"), one in a tank 31 N
# s/m, and three times as much with a third of the thrust. About the axes of rotation, by the same factors,
# 0.02 to 30 kg m2.
SCALE = {"remedy": "for thrusters k times as strong as T200, divide masses, inertias and damping by k"}
Mass = Annotated[float, Meta(ge=1.0, le=1000.0, extra=SCALE, extra_json_schema={"unit": "kg"})]
LinearDamping = Annotated[float, Meta(ge=0.0, le=300.0, extra=SCALE, extra_json_schema={"unit": "N·s/m"})]
QuadraticDamping = Annotated[
    float, Meta(ge=0.0, le=1000.0, extra=SCALE, extra_json_schema={"unit": "N·s²/m²"})
]
Force = Annotated[float, Meta(ge=0.1, le=500.0, extra_json_schema={"unit": "N"})]
Inertia = Annotated[float, Meta(ge=0.02, le=100.0, extra=SCALE, extra_json_schema={"unit": "kg·m²"})]
LinearTurnDamping = Annotated[
    float, Meta(ge=0.0, le=30.0, extra=SCALE, extra_json_schema={"unit": "N·m·s/rad"})
]
QuadraticTurnDamping = Annotated[
    float, Meta(ge=0.0, le=100.0, extra=SCALE, extra_json_schema={"unit": "N·m·s²/rad²"})
]
Coupling = Annotated[float, Meta(ge=-8.0, le=8.0, extra=SCALE, extra_json_schema={"unit": "N·s"})]
Moment = Annotated[float, Meta(ge=0.1, le=100.0, extra_json_schema={"unit": "N·m"})]
MaxRate = Annotated[float, Meta(ge=0.01, le=3.0)]
MaxAcceleration = Annotated[float, Meta(ge=0.01, le=5.0)]

# Gains: `holdfast lab tune` searches λ up to 24, κ up to 48 and learning rates up to 600.
Lambda = Annotated[float, Meta(ge=0.05, le=30.0)]
Kappa = Annotated[float, Meta(ge=0.05, le=50.0)]
LearningRate = Annotated[float, Meta(ge=0.0, le=1000.0, extra_json_schema={"least": 1e-3})]
HiddenLearningRate = Annotated[float, Meta(ge=0.0, le=100.0, extra_json_schema={"least": 1e-3})]
Leak = Annotated[float, Meta(ge=0.0, le=1.0, extra_json_schema={"least": 1e-6})]
DeadZone = Annotated[float, Meta(ge=0.0, le=0.5, extra_json_schema={"least": 1e-6})]

# Noise of a sample (never exactly none: the Kalman gain divides by it), and of the disturbance per √s.
Noise = Annotated[float, Meta(ge=1e-5, le=1.0)]
SlowNoise = Annotated[float, Meta(ge=0.0, le=1.0, extra_json_schema={"least": 1e-5})]
DisturbanceNoise = Annotated[float, Meta(ge=0.01, le=100.0)]

# Times, seconds.
Delay = Annotated[float, Meta(ge=0.0, le=1.0)]
HiddenDelay = Annotated[float, Meta(ge=0.0, le=0.1)]
RangeDelay = Annotated[float, Meta(ge=0.0, le=1.2)]
BorneDelay = Annotated[float, Meta(ge=0.01, le=1.0)]
Lag = Annotated[float, Meta(ge=0.02, le=1.0)]
Lead = Annotated[float, Meta(ge=0.0, le=0.3)]
Correlation = Annotated[float, Meta(ge=0.05, le=60.0)]
Timeout = Annotated[float, Meta(ge=0.05, le=10.0)]
PilotTimeout = Annotated[float, Meta(ge=0.5, le=60.0)]
FailsafeTimeout = Annotated[float, Meta(ge=0.1, le=3.0)]
Ramp = Annotated[float, Meta(ge=0.1, le=10.0)]
Patience = Annotated[float, Meta(ge=0.0, le=60.0)]
Hour = Annotated[float, Meta(ge=0.0, le=3600.0, extra_json_schema={"least": 0.01})]

# Thrusters, sticks and levelling.
Share = Annotated[float, Meta(ge=0.05, le=1.0)]
PartOfWhole = Annotated[float, Meta(ge=0.0, le=1.0)]
PilotDeflection = Annotated[float, Meta(ge=0.02, le=0.5)]
FullDeflection = Annotated[float, Meta(ge=0.5, le=1.0)]
Slew = Annotated[float, Meta(ge=0.5, le=100.0)]
TickRate = Annotated[float, Meta(ge=10.0, le=200.0)]
LevellingFrequency = Annotated[float, Meta(ge=0.2, le=20.0)]
Righting = Annotated[
    float, Meta(ge=0.0, le=300.0, extra=SCALE, extra_json_schema={"unit": "N·m/rad", "least": 0.01})
]
Lever = Annotated[float, Meta(ge=-1.0, le=1.0)]
TiltShare = Annotated[float, Meta(ge=0.01, le=0.49)]

# Places and what bounds them.
Depth = Annotated[float, Meta(ge=0.0, le=1000.0)]
Altitude = Annotated[float, Meta(ge=0.1, le=200.0)]
MaxDepth = Annotated[float, Meta(ge=0.5, le=1000.0)]
Metres = Annotated[float, Meta(ge=-1e4, le=1e4)]
HeldAngle = Annotated[float, Meta(ge=-90.0, le=90.0)]
HeadingDeg = Annotated[float, Meta(ge=-360.0, le=360.0)]
DepthMargin = Annotated[float, Meta(ge=0.0, le=20.0)]
Distance = Annotated[float, Meta(ge=0.01, le=10.0)]
AngleDeg = Annotated[float, Meta(ge=0.5, le=180.0)]
TiltDeg = Annotated[float, Meta(ge=10.0, le=89.0)]
EkfVariance = Annotated[float, Meta(ge=0.05, le=10.0)]
Voltage = Annotated[float, Meta(ge=6.0, le=30.0)]

# Velocities.
Speed = Annotated[float, Meta(ge=-3.0, le=3.0)]
TurnRate = Annotated[float, Meta(ge=-90.0, le=90.0)]
VelocityTime = Annotated[float, Meta(ge=0.1, le=10.0)]

# Paths.
Length = Annotated[float, Meta(ge=0.1, le=1000.0)]
Corner = Annotated[float, Meta(ge=0.0, le=100.0, extra_json_schema={"least": 1e-3})]
PathSpeed = Annotated[float, Meta(ge=0.01, le=3.0)]
PathAcceleration = Annotated[float, Meta(ge=0.01, le=1.0)]

# Whole numbers.
Laps = Annotated[int, Meta(ge=0, le=1000)]
SystemId = Annotated[int, Meta(ge=1, le=255)]
LinkId = Annotated[int, Meta(ge=0, le=255)]
Button = Annotated[int, Meta(ge=-1, le=15)]
Units = Annotated[int, Meta(ge=1, le=100)]
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]
