"""A deployment of the thesis' time (annotated pods, claims in node annotations, a fleet map by pod uid) becomes RobotApps. Pure."""
