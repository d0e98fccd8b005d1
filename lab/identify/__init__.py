"""Logs of any dive: what was commanded, what was measured, and the vehicle that explains it."""
