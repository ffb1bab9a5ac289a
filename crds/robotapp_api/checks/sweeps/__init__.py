"""What is wrong with a sweep."""
