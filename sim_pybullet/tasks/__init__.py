"""What robots are asked to do: each task is one small file that keeps ``base.Task``."""
