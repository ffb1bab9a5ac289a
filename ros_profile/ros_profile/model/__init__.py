"""Plain data: what is read from a package, and what is concluded from it."""
