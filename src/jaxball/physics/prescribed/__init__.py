"""Motions that are prescribed: rails and their frames, schedules and signals over time, and masses that follow them."""
