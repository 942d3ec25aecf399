"""From simulation to reality: CycleGAN on unpaired pictures, SegNet, pix2pix by way of classes."""
