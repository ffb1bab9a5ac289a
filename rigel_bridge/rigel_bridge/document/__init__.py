"""A Rigelfile as a tree with line numbers: reading within bounds, typed access, templates, messages."""
