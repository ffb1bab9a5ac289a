"""From what is wanted and what is there to the writes that are missing."""
