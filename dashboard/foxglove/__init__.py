"""What Foxglove and Lichtblick can draw, of a recording and of a vehicle that is live."""
