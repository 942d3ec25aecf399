"""The robot: the contract shared with the simulator, and the lean runtime of a Jetson Nano.

Imports nothing of ours; numpy and the standard library everywhere; cv2, onnxruntime, pyzmq
and smbus2 only inside the functions that need each. Python 3.8.
"""

__version__ = "0.1.0"
