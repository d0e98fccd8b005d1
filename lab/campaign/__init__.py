"""Thousands of drawn dives."""
