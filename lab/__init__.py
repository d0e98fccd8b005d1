"""Where companion and sim_bridge meet in virtual time, and the soak where they meet in real time."""
