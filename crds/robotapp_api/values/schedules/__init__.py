"""Schedules: when the job of a component is due again."""
