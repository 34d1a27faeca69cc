"""The episode editor: `draft` holds what is edited, `assessment` checks it, the other modules show both."""
