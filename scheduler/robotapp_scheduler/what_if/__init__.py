"""What would be: pods that would move and edges whose verdict would change, on a copy of the running scheduler's cache."""
