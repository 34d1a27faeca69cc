"""What an episode must fulfil to be accepted, each rule measured against the built scene.

`rules.check(world)` gives every rule's finding; `rules.check_all` does so for many records on several processes.
"""
