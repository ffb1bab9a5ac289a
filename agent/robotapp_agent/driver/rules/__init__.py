"""Decisions of the driver. Pure: objects and readings in, slices, CDI specs and refusals out."""
