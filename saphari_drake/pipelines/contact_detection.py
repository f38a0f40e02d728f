"""From the residual to whether somebody touches: what the model lacks is learned, and thresholds follow."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.estimation.model_error import ModelErrorEstimator, ModelErrorParameters
from saphari_drake.estimation.momentum_observer import MomentumObserver, MomentumObserverParameters
from saphari_drake.parameters import diagonal
from saphari_drake.robots.model import RobotModel
from saphari_drake.safety.contact_detector import ContactDetector, ContactDetectorParameters
from saphari_drake.systems import connect


def add_contact_detection(
    builder: DiagramBuilder,
    robot: RobotModel,
    observer: MomentumObserver,
    observed: MomentumObserverParameters,
    model_error: ModelErrorParameters,
    detector: ContactDetectorParameters,
) -> tuple[ModelErrorEstimator, ContactDetector]:
    """Add an estimator of what the model lacks, and a detector of contacts, behind an observer with its parameters.

    At rest friction is anywhere between both directions, whatever the observer remembers; thresholds lie above what
    the known friction may be wrong by. `dynamics` of the estimator is left to connect.
    """
    dry = diagonal(observed.friction.coulomb, robot.n, "coulomb")
    stiction = np.maximum(diagonal(model_error.stiction, robot.n, "stiction"), 2.0 * dry)
    wrong = observed.friction.uncertainty * dry
    above = replace(
        detector,
        threshold=(diagonal(detector.threshold, robot.n, "threshold") + wrong).tolist(),
        smoothed_threshold=(detector.smoothed_threshold + wrong).tolist(),
    )
    bandwidth = list(observed.bandwidth * np.ones(robot.n))
    estimator = builder.AddNamedSystem(
        "model_error", ModelErrorEstimator(robot, replace(model_error, stiction=stiction.tolist()), bandwidth)
    )
    felt = builder.AddNamedSystem("contact_detector", ContactDetector(robot.n, above))
    connect(
        builder,
        (observer, "torque_external", estimator),
        (estimator, "torque_external", felt),
        (estimator, "torque_uncertainty", felt),
        (estimator, "torque_noise", felt),
        (felt, "contact", estimator),
    )
    return estimator, felt
