"""What the vision pilot knows of the catalogue's shapes: pictures to learn from, and the fit."""
