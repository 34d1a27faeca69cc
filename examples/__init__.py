"""What may be built with the project, each folder one example; none of it is in the wheel."""
