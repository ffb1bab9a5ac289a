"""Rigelfile in, RobotApp out. Needs PyYAML only, so it also lives in Rigel's own environment."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("robotapp")
except PackageNotFoundError:  # copied next to Rigel instead of installed
    __version__ = "0"
