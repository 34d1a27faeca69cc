"""What a reply says: one action per drone, or why there is none. docs/replies.md."""
