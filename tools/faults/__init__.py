"""Every fault that a robot can meet, against the whole system on the loop bench."""
