"""One file with everything that is needed to judge runs again, and what checks it on another machine."""
