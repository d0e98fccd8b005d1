"""`python -m holdfast`."""

from holdfast import run

run()
