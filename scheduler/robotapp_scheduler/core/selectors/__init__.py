"""Which pods a selector matches, and how many of them are on which nodes."""
