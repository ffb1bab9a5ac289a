"""Launch files of ROS 1 and ROS 2, in three formats, as one kind of description."""
