"""Objects by app and instance."""
