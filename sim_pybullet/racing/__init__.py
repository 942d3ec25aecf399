"""Race tracks, their ground and walls, and cars with speed dynamics."""
