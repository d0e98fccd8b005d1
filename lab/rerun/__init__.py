"""Recorded dives and telemetry logs through today's engine."""
