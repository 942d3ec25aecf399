"""What the robot recognises in a picture without a network."""
