"""The loop bench: robot, localizer and monitor as they are, against virtual hardware."""
