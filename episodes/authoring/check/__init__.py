"""The rules that an episode must pass to be accepted, each measured in the built scene.

`rules.check(world)` returns the findings of all rules; `rules.check_all` checks many records on several processes.
"""
