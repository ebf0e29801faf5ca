"""Bodies whose equations switch without a law of contact: dry friction holds a body, or its joints."""
