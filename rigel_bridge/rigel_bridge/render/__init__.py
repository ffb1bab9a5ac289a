"""What is written: the RobotApp, checked against the definition that the API server has."""
