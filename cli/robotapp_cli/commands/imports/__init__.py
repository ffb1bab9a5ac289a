"""The command `import`: a RobotApp from compose files or from a launch file, and a report."""
