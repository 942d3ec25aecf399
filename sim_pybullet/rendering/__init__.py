"""The two cameras: rays read from the painted floor, and PyBullet's own picture."""
