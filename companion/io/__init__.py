"""Links, Zenoh, logs: where bytes enter and leave the process."""
