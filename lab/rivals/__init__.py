"""What Holdfast is measured against: other laws in its own controller, and ArduSub's depth hold on board.

The laws follow the protocol of `companion/core/law.py`, as anybody's: a bench's row gives heave to them.
"""
