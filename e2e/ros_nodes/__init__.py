"""A teleoperation pair as real programs: an operator sends /cmd_vel, a robot answers each with /robot_state.

Runs in the images ros2 (Cyclone DDS with ROS 2's names on the wire) and ros1 (rospy); nothing of the testbed is imported here.
"""
