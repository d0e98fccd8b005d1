"""What only measures the processes: memory, lateness and lost records, for hours."""
