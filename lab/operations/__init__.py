"""What only measures the process: memory, lateness, subscribers, many vehicles, hours."""
