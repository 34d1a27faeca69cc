"""Films of flights, made from a run folder alone: who was where (`flown`), from where it is looked at (`chase`,
`stage`), what stands beside it (`panes`), and how pictures become a file that is gone on with (`parts`, `encoders`)."""
