"""Joint placement of a group: pure arithmetic on arrays, no part of the scheduler's core, so that a worker starts quickly."""
