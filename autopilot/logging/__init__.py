"""The flight log on board: what is written between arming and disarming, and where the files lie."""
