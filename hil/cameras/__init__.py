"""Real cameras: any address gives frames that are new, stamped when they were taken, and straight."""
