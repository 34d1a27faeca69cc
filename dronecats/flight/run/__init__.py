"""Runs episodes: starts what a flight stands on, flies to the start pose, lets the agent fly, lands, tidies up."""
