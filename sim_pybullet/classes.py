"""The semantic classes of every segmentation picture, named once."""

from enum import IntEnum


class SemanticClass(IntEnum):
    """Values of a segmentation picture, uint8."""

    SKY = 0
    OUTSIDE = 1  # floor, grass and what lies beyond the map
    ROAD = 2
    WHITE_LINE = 3
    YELLOW_LINE = 4
    RED_LINE = 5
    OBJECT = 6  # anything solid that is not one of the following
    SIGN = 7
    PERSON = 8  # duckies
    VEHICLE = 9
    KERB = 10
    WALL = 11
