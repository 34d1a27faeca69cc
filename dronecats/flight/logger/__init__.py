"""A process of its own that writes down what really happened."""
