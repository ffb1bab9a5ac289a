"""The screen of one app: its page, what can be done with it, and what happened to it."""
