"""Evaluation within a solve's steps: its dense output, zero crossings, maxima and integrals."""
