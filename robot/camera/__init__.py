"""Cameras: the newest frame, whatever it comes from.

| file | what it holds |
|---|---|
| ``source`` | ``Frame``, the ``Camera`` protocol, and how any picture becomes a frame |
| ``replay`` | a folder of pictures or a video file, by the clock |
| ``newest`` | a thread that keeps the newest picture of a stream, and opens it again when it ends |
| ``v4l2``, ``gstreamer`` | the streams: a USB camera, a CSI camera |
"""
