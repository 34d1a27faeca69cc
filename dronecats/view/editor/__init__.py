"""The episode editor. `draft` has the drafts, `assessment` checks them, and the other modules are the interface."""
