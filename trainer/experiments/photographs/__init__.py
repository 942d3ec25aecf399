"""Real photographs: what policies look at, whether lines are found, and what people would do."""
