"""Many trials of an experiment: on the cores of a machine or on a cluster, counted, searched and replayed."""
