"""Where companion and sim_bridge meet in virtual time."""
