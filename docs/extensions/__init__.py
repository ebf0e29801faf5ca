"""What the site makes of the package itself: its interface, its commands, its scenarios and examples."""
