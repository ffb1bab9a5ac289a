"""Components that end: what a Job has come to, and what that means for its instance."""
