"""A Rigelfile as a tree that knows its lines: reading within bounds, typed access, templates, messages."""
