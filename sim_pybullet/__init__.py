"""The simulated world: PyBullet bodies, fisheye cameras, looks, tasks and virtual hardware."""
