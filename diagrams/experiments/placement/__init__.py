"""Where things are put for an arm that an experiment was not made for: by limits, reach, posture and rank."""
