"""Where the robot is, where it should go and along which path."""
