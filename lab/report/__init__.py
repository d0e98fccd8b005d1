"""The page after a dive."""
