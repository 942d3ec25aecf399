"""The camera: rays read from the painted floor, and solids over it."""
