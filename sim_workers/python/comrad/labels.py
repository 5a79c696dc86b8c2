"""What the values in a picture of labels mean."""

from typing import NamedTuple


class Label(NamedTuple):
    """A thing that is seen, with the names of ViZDoom's Label.

    value                 of its pixels in the picture of labels: 2 to 254, the nearer the higher; 255 for the weapon in hand, whose
                          object is the player that holds it. Walls and sky are 0, floors and ceilings 1
    object_id             of the thing, the same through the episode
    object_name           its class: "Medikit", "DoomImp"
    x, y, width, height   the box of its pixels; (0, 0) is the upper left corner of the picture
    object_position_...   map units; object_angle: degrees, 0 is east, 90 north; object_velocity_...: map units a tic
    """

    value: int
    object_id: int
    object_name: str
    x: int
    y: int
    width: int
    height: int
    object_position_x: float
    object_position_y: float
    object_position_z: float
    object_angle: float
    object_velocity_x: float
    object_velocity_y: float
    object_velocity_z: float
