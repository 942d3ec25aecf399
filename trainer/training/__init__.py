"""A training from its first step to its last, its evaluations and checkpoints."""
