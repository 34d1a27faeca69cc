"""What a slow or wavering model, a bad wire or the wind costs: designed, flown and fitted."""
