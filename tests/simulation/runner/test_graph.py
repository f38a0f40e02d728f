"""The block diagram of a Diagram: systems and connections, without what only records."""

import shutil

import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Gain, LogVectorOutput

from saphari_drake.errors import ParameterError
from saphari_drake.robots import catalog
from saphari_drake.robots.dynamics import RobotDynamics
from saphari_drake.simulation.runner.graph import BlockDiagram


def small():
    """Return a diagram of a source, a gain that is logged, and a system of this library."""
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("source", ConstantVectorSource([1.0] * 7))
    gain = builder.AddNamedSystem("gain", Gain(k=2.0, size=7))
    terms = builder.AddNamedSystem("terms", RobotDynamics(catalog.lwr4()))
    builder.Connect(source.get_output_port(), gain.get_input_port())
    for port in ("position_measured", "velocity_measured"):
        builder.Connect(gain.get_output_port(), terms.GetInputPort(port))
    LogVectorOutput(gain.get_output_port(), builder).set_name("log")
    return builder.Build()


def test_systems_and_connections_are_drawn_and_logs_are_not():
    whole, text = small().GetGraphvizString(), BlockDiagram(small()).text
    assert "VectorLogSink" in whole and "VectorLogSink" not in text
    assert '"source" -> "gain" [label="y0"]' in text and '"gain" -> "terms"' in text
    assert (whole.count(" -> "), text.count(" -> ")) == (4, 2)
    assert "<B>terms</B><BR/>RobotDynamics" in text


@pytest.mark.skipif(shutil.which("dot") is None, reason="the program 'dot' of Graphviz is not installed")
def test_a_notebook_shows_the_picture():
    svg = BlockDiagram(small())._repr_svg_()
    assert "<svg" in svg and "RobotDynamics" in svg and "source" in svg


def test_without_graphviz_a_notebook_shows_text_and_an_image_is_refused(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert BlockDiagram(small())._repr_svg_() is None
    with pytest.raises(ParameterError, match="needs the program 'dot'"):
        BlockDiagram(small()).image("svg")
