"""The posture and the guided point that the tests of hand guiding share."""

import numpy as np

HOME = np.deg2rad([90.0, -35.0, 0.0, 68.0, 0.0, -65.0, 0.0])
TIP = np.array([0.0, 0.0, 0.12])
