"""Scene parsing (paper B): classes of the road, SegNet, labelled real and simulated frames."""
