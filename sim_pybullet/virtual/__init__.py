"""Virtual hardware: what the robot's drivers cannot tell from the real thing.

Runs under Python 3.8 with numpy alone, so that the robot's own tests can use it.
"""
