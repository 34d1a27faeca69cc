"""The world of one episode at one time: static objects, moving targets and visibility."""
