"""The tests of duckpilot."""

import os

# Small networks gain nothing from a second thread, and two test processes on two cores lose by it.
os.environ.setdefault("OMP_NUM_THREADS", "1")
