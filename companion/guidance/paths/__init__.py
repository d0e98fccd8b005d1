"""Paths: their geometry, what they are made of, and how fast they are travelled."""
