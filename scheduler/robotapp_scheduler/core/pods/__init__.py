"""A pod prepared for scheduling, and what pods have in common."""
