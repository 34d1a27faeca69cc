"""The world of one episode at one time: what stands, what moves and what is visible."""
