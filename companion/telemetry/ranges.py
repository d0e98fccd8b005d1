"""What each quantity that a user may set can meaningfully be.

What the configuration, commands, paths, the command line and the dashboard share; what the configuration
alone has stands there, beside its key. A range ends where a value says nothing of a vehicle that these
thrusters can hold: it takes in what is shipped, what `holdfast lab tune` searches and the published BlueROV2
models with room to spare, and leaves out what switches a protection off. Units are m, N and kg; on the yaw
axis rad, N·m and kg·m².
"""

from typing import Annotated

from companion.telemetry.fields import within

# Places and what bounds them.
Depth = Annotated[float, within(0.0, 1000.0)]
Altitude = Annotated[float, within(0.1, 200.0)]
Metres = Annotated[float, within(-1e4, 1e4)]
HeldAngle = Annotated[float, within(-90.0, 90.0)]
HeadingDeg = Annotated[float, within(-360.0, 360.0)]

# Velocities, and how long one lasts.
Speed = Annotated[float, within(-3.0, 3.0)]
TurnRate = Annotated[float, within(-90.0, 90.0)]
VelocityTime = Annotated[float, within(0.1, 10.0)]

# Paths.
Length = Annotated[float, within(0.1, 1000.0)]
Corner = Annotated[float, within(0.0, 100.0, beside_zero=1e-3)]
PathSpeed = Annotated[float, within(0.01, 3.0)]
PathAcceleration = Annotated[float, within(0.01, 1.0)]
Hour = Annotated[float, within(0.0, 3600.0, beside_zero=0.01)]
Laps = Annotated[int, within(0, 1000)]

# Thrusters.
Lag = Annotated[float, within(0.02, 1.0, "from a motor's command to its thrust; T200: 0.1 to 0.2 s")]

# Gains: `holdfast lab tune` searches λ up to 24, κ up to 48 and learning rates up to 600.
Lambda = Annotated[
    float, within(0.05, 30.0, "1/lambda + 1/kappa must exceed the delay and the thrusters' lag", title="λ")
]
Kappa = Annotated[float, within(0.05, 50.0, "how hard the law pulls to the decay by lambda", title="κ")]
LearningRate = Annotated[
    float, within(0.0, 1000.0, "of the chosen compensator", title="learning rate", beside_zero=1e-3)
]
HiddenLearningRate = Annotated[
    float, within(0.0, 100.0, "of the network's hidden layer", title="hidden rate", beside_zero=1e-3)
]
Leak = Annotated[float, within(0.0, 1.0, "how fast the compensator forgets", title="leak", beside_zero=1e-6)]
DeadZone = Annotated[
    float,
    within(0.0, 0.5, "combined error without learning", "m/s or rad/s", title="dead zone", beside_zero=1e-6),
]
MaxDisturbance = Annotated[
    float,
    within(0.1, 500.0, "0.5 m/s of current: 42 N from ahead, 54 N abeam", "N or N·m", title="limit of d̂"),
]

# Noise of a sample (never exactly none: the Kalman gain divides by it), and of the disturbance per √s.
PositionNoise = Annotated[float, within(1e-5, 1.0, "white", "m or rad", title="position noise")]
RateNoise = Annotated[float, within(1e-5, 1.0, "white", "m/s or rad/s", title="rate noise")]
SlowPositionNoise = Annotated[
    float,
    within(0.0, 1.0, "over delays.slow_noise_s", "m or rad", title="slow position noise", beside_zero=1e-5),
]
SlowRateNoise = Annotated[
    float,
    within(0.0, 1.0, "over delays.slow_noise_s", "m/s or rad/s", title="slow rate noise", beside_zero=1e-5),
]
DisturbanceNoise = Annotated[
    float, within(0.01, 100.0, "change of the disturbance", "N/√s or N·m/√s", title="disturbance noise")
]
