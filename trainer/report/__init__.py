"""What runs have come to: curves, tables beside the paper's, drive maps and the worst episodes."""
