"""The operator's page: map, camera, missions, health and emergency stop, in a browser.

``python -m tools.monitor --demo`` shows it on virtual hardware.
"""

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
