"""What a trained policy is worth: driven, endured, explained."""
