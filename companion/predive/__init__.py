"""The pre-dive list: what was seen of the vehicle and what it means."""
