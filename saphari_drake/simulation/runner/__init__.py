"""The runner of experiments: scenarios, command line, results."""
