"""Certificates for tests: an authority, and what it signs."""

from robotapp_testbed.control_plane.authority import PEM, Authority

__all__ = ["PEM", "Authority"]
