"""Run many trials of an experiment, search for its worst case, or replay a trial.

`python diagrams/sweep.py --help` tells how.
"""

import sys

from experiments.sweep.command import main

if __name__ == "__main__":
    sys.exit(main(None))
