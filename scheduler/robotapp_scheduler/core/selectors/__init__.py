"""Which pods a selector means, and how many of them are where."""
