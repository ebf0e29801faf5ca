"""Evaluation within a solve's steps: samples of its dense output, zero crossings and maxima."""
