"""Asks the real ArduSub and our stand-in the same, in virtual time, and prints where they differ."""
