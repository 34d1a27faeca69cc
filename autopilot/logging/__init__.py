"""The on-board flight log: the ULog format, the logged topics, and the folder of the files."""
