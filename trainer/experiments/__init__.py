"""The experiments of paper B, one command each."""
