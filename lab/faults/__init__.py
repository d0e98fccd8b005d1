"""Dives in which something breaks."""
