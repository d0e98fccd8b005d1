"""The stand-in vehicle: a 6-DOF ROV and an ArduSub double behind a MAVLink port. Shares no code with companion."""
