"""Bodies whose equations switch without a law of contact: joints that stick, and dry resistance that holds a body."""
