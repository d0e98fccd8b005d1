"""A Gymnasium environment: a policy takes the place of the law's feedback, in the loop of `lab.batch`."""
