"""Recordings: written, read, mended, replayed."""
