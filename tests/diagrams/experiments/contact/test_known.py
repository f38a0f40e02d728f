"""What is known of encoders and friction reaches the observer."""

import numpy as np
from experiments.contact.known import adapt_to_encoders, adapt_to_friction

from saphari_drake.pipelines.contact import ContactPipelineParameters
from saphari_drake.robots.corrections import RobotCorrections, corrected
from saphari_drake.simulation.sensors.joint_sensor import JointSensorParameters


def test_coarse_encoders_are_averaged_and_fine_ones_are_not(lwr4):
    for resolution, averaged in ((1e-5, 1), (2.0 * np.pi / 2**16, 2)):
        pipeline = ContactPipelineParameters()
        adapt_to_encoders(pipeline, lwr4, JointSensorParameters(position_resolution=resolution))
        assert pipeline.observer.averaged == averaged or (averaged > 1 and pipeline.observer.averaged >= averaged)


def test_the_observer_is_told_friction_that_was_identified(lwr4):
    pipeline = ContactPipelineParameters()
    adapt_to_friction(pipeline, lwr4, JointSensorParameters())
    assert pipeline.observer.friction.coulomb == 0.0
    adapt_to_friction(pipeline, corrected(lwr4, RobotCorrections(coulomb=[0.3] * 7)), JointSensorParameters())
    assert pipeline.observer.friction.coulomb == [0.3] * 7
