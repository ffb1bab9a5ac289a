"""Fixtures of the testbed: one control plane per test session, a namespace per test."""
