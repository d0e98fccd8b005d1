"""One dive in virtual time: the engine and a vehicle exchange MAVLink bytes."""
