"""Certificates for tests: an authority, and what it signs."""

from robotapp_testbed.authority import PEM, Authority

__all__ = ["PEM", "Authority"]
