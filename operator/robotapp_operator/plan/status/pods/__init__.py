"""Explanations of pods that do not run."""
