"""The robot's loop and what it is put together from."""
