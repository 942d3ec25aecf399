"""Cameras: the newest frame, whatever it comes from.

| file | what it holds |
|---|---|
| ``source`` | ``Frame``, ``Camera``, and a thread that keeps the newest picture of a stream |
| ``streams`` | what can be opened: a USB camera, a CSI camera, a virtual one |
| ``replay`` | a folder of pictures or a video file, by the clock |
"""
