"""Records that several tests begin with."""

from companion.records import ZERO, Ages, Delays, VehicleState

RESTING = VehicleState(
    t_s=10.0,
    boot_s=5.0,
    eta=ZERO,
    eta_dot=ZERO,
    ahead_s=0.1,
    eta_ahead=ZERO,
    eta_dot_ahead=ZERO,
    disturbance=ZERO,
    roll=0.0,
    pitch=0.0,
    p=0.0,
    q=0.0,
    armed=True,
    mode=19,
    system_status=4,
    voltage_v=16.0,
    pilot_gain=0.5,
    ages=Ages(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    delays=Delays(0.01, 0.01, True, True),
)
"""Armed, in MANUAL, at rest at the surface; all that can be known was just heard."""
