"""Every fault that a robot can meet, against the whole system on the loop bench."""

FAMILIES = (
    *("camera", "pictures", "I2C", "model", "localizer", "programs", "network"),
    *("strangers", "missions", "ways", "recording", "traffic", "by sight"),
)
