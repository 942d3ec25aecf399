"""The operator's page: map, camera, missions, health and emergency stop, in a browser.

``python -m tools.monitor --demo`` shows it on virtual hardware.
"""
