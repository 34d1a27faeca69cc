"""Examples of what can be built with the project, one in each folder. The wheel has none of them."""
