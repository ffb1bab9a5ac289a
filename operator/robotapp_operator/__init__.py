"""The operator: turns RobotApps into Deployments, domain claims, a fleet view and status."""

from importlib.metadata import version

__version__ = version("robotapp")
