"""What leaves the companion and what may be asked of it: keys, schemas, commands, ranges."""
