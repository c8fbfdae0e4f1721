"""What the hoop may have beside its equations: the rolling ball's contact, slip and flight, and the frame below it."""
