"""`holdfast install` and `holdfast uninstall`: Holdfast as services of systemd.

It imports the standard library alone, so that `python3 -m holdfast install` works out of the wheel itself.
"""
