"""Real photographs: what policies look at, and whether lines are found."""
