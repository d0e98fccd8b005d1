"""Where companion and sim_bridge meet in virtual time, and the demo where they meet in real time."""
