"""From an assembled robot to its first drive: rolling by hand, self-test, calibration."""
