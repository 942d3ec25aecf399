"""Every fault that a robot can meet, against the whole system on the loop bench."""

FAMILIES = {  # of cases, and the module that has each
    "camera": "camera",
    "pictures": "pictures",
    "I2C": "i2c",
    "model": "models",
    "localizer": "localizer",
    "programs": "programs",
    "network": "network",
    "strangers": "strangers",
    "missions": "missions",
    "ways": "ways",
    "recording": "recording",
}
