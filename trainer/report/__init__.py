"""What runs have come to: curves, tables beside the paper's, films of the worst episodes."""
