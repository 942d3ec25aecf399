"""What is right and wrong with this computer as a robot, and what to do about it."""
