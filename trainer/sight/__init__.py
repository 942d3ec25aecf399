"""Teaching the network of `robot.vision.sight`, and judging what it sees."""
