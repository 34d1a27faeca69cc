"""The episode editor: `draft` is what is being edited, `assessment` what is true of it, the rest shows both."""
