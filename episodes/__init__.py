"""The world: maps, assets, camera, targets, visibility and the episode records. It has no flight code."""
