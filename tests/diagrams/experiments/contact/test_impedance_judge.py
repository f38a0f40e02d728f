"""The order of the return times is judged once all three axes have been pushed."""

from types import SimpleNamespace

import numpy as np
import pytest
from experiments.contact import judge
from experiments.contact.impedance_judge import return_metrics

from saphari_drake.simulation.people.pushing_hand import Push

CONTROLLER = SimpleNamespace(K_p=500.0, K_d=80.0, M_d=[20.0, 3.0, 10.0])
SETUP = SimpleNamespace(
    scenario=SimpleNamespace(system=SimpleNamespace(pipeline=SimpleNamespace(controller=CONTROLLER))), robot=None
)


@pytest.mark.parametrize(
    ("times", "ordered"),
    [((1.6, 0.5, 0.8), 1.0), ((0.5, 1.6, 0.8), 0.0), ((1.6, np.nan, 0.8), 0.0), ((1.6,), np.nan), ((1.6, 0.5), np.nan)],
)
def test_order_of_the_return_times(monkeypatch, times, ordered):
    touches = [
        SimpleNamespace(push=Push("link_6", direction=np.eye(3)[k].tolist()), time=t) for k, t in enumerate(times)
    ]
    monkeypatch.setattr(judge, "return_time", lambda log, robot, touch: touch.time)
    monkeypatch.setattr(judge, "position_error_final", lambda log, robot, touch: 0.0)
    values = {metric.name: metric.value for metric in return_metrics(SETUP, None, touches)}
    np.testing.assert_equal(values["return_times_ordered"], ordered)
    assert sum(name.startswith("return_time_") and name.endswith("_s") for name in values) == len(times)
