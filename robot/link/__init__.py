"""Links between robot, localizer and monitor: what they say, to whom, and how fresh it is."""
