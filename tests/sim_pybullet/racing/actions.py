"""The actions of racing cars, by name."""

from enum import IntEnum


class RacingAction(IntEnum):
    """Paper B, section 3.1, in its order."""

    STRAIGHT_ACCELERATE = 0
    LEFT_ACCELERATE = 1
    RIGHT_ACCELERATE = 2
    STRAIGHT_BRAKE = 3
    LEFT_BRAKE = 4
    RIGHT_BRAKE = 5
    STRAIGHT = 6
    LEFT = 7
    RIGHT = 8
