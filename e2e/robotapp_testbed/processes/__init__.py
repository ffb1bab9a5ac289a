"""Processes of one run: started, watched, written to a log, and ended whatever happens to their owner."""
