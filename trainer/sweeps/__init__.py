"""Many trainings or evaluations at once: as jobs, in processes or on a Ray cluster."""
