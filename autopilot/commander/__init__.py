"""The commander: arming, modes, failsafes, and the plans that a ground station uploads."""
