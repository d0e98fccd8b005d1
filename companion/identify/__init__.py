"""`holdfast identify`: a manoeuvre, the model that explains it, and the vehicle's file of it."""
