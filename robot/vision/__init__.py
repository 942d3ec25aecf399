"""Whether what the camera shows can be believed, without a network."""
