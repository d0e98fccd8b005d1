"""Where the vehicle is, and how late everything is."""
