"""The search for gains."""
