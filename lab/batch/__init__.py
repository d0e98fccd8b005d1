"""Many dives at once, without MAVLink bytes."""
