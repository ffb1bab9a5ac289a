"""A Profile as text, JSON, annotations, Rigelfile block, RobotApp, and the difference of two. Pure."""
