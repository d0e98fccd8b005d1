"""The array form of the equations, until the compiled one has taken its place."""
