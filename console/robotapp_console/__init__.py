"""The web console: shows the fleet, apps and nodes in a browser, with the rights of the person who looks."""
