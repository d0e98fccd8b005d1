"""What is wanted: the setpoint, and what the pilot asks for."""
