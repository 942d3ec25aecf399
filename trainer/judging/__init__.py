"""What a trained policy is worth: driven and explained."""
