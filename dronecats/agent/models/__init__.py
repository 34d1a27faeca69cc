"""Models behind one interface, a file per wire format."""
