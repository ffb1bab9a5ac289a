"""The parts of a RobotApp, one module per group of fields."""
