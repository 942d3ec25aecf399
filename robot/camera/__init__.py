"""Cameras: the newest frame, whatever it comes from; and pictures from files."""
