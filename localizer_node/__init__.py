"""The overhead camera: finds the robots on the floor and says where they are."""
