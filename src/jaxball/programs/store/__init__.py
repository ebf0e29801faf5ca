"""Compiled programs as files, kept between processes."""
