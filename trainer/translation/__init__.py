"""Simulated pictures made to look real, and real ones simulated: CycleGAN on unpaired folders."""
