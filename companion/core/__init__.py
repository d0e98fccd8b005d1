"""The equations and their one order."""
