"""Drives as MCAP files: written while driving, opened in Foxglove, replayed bit for bit."""
