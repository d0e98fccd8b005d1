"""The vehicle in the water."""
