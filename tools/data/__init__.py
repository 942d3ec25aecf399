"""Recorded drives: told, cut, divided, and to and from what others learn from."""
