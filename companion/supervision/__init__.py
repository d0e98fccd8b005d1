"""Who may steer: conditions, transitions, flight mode, guard."""
