"""The documentation site, where it was built."""
