"""Every fault that a robot can meet, against the whole system on the loop bench."""

FAMILIES = {  # of cases, and the module that has each
    "camera": "eyes",
    "pictures": "eyes",
    "I2C": "hardware",
    "model": "programs",
    "localizer": "poses",
    "programs": "programs",
    "network": "network",
    "strangers": "strangers",
    "missions": "programs",
    "ways": "poses",
    "recording": "hardware",
}
