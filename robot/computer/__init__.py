"""This computer: threads, sockets, systemd, its health, and what the robot costs it."""
