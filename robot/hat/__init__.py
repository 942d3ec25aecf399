"""The motor side of the robot: a stepper HAT (PCA9685 and two TB6612) on an I2C bus.

``driver.MotorDriver`` is what the runtime uses; ``docs/wiring.md`` is for the maker.
"""
