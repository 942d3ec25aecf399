"""What stands in a world."""
