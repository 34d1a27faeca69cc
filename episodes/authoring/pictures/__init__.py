"""Pictures of maps, assets and records, for people."""
