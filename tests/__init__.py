"""The tests of duckpilot."""

import os

# Small networks and pictures gain nothing from a second thread, and two test processes on two cores
# lose by it: threads that wait for each other's turn wait busily.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")
