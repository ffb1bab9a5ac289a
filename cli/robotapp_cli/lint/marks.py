"""Marks of places that a person has to fill in before a file is applied, as `kubectl robotapp import` writes them."""

from typing import Final

MARK: Final = "CHOOSE-A"
"""Begins every mark. In capitals, because no image, distribution or name of an object is written so."""
IMAGE_MARK: Final = "CHOOSE-AN-IMAGE"
DISTRO_MARK: Final = "CHOOSE-A-DISTRO"
PATH_MARK: Final = "CHOOSE-A-PATH"
VALUE_MARK: Final = "CHOOSE-A-VALUE"

_CURES: Final = {
    IMAGE_MARK: "write the name of the image, such as registry.example/driver:1.2",
    DISTRO_MARK: "write the ROS distribution of the images, such as jazzy, or none for an app without ROS",
    VALUE_MARK: "write the value that the variable of the compose file has on the robot",
    PATH_MARK: "write the path on the node, such as /home/robot/maps",
}


def describe_mark(text: str) -> str:
    """Returns the sentence for a value that has a mark in it, "" for every other value."""
    if MARK not in text:
        return ""
    cure = next((cure for mark, cure in _CURES.items() if mark in text), "write the value")
    return f"this place was marked by the import and is still to be filled in; {cure}"
