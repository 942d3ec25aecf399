"""The motor side of the robot: a stepper HAT (PCA9685 and two TB6612) on an I2C bus."""
