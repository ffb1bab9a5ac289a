"""HTTP: sessions, security rules, pages and streams."""
