"""The depth camera: pose, half-pixel convention, agreement of both engines, and what it says when it cannot start."""

import builtins
import subprocess

import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, MeshcatCone, Sphere
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia, default_model_instance
from pydrake.systems.framework import DiagramBuilder

from saphari_drake.errors import ParameterError, SensorError, UnknownNameError
from saphari_drake.parameters import validate
from saphari_drake.perception.camera import open3d_import
from saphari_drake.perception.camera.model import CameraParameters, camera_pose, ray_tables
from saphari_drake.robots.catalog import load, lwr4
from saphari_drake.simulation.sensors import rgbd_camera
from saphari_drake.simulation.sensors.rgbd_camera import add_depth_camera, check_renderer

TETRAHEDRON = Convex(points=0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]).T, label="mesh")
CENTRE, RADIUS = np.array([-0.2, 0.4, 0.9]), 0.12


def renderer_missing():
    try:
        check_renderer()
    except SensorError as error:
        return str(error)
    return ""


ENGINES = [
    "raycast",
    pytest.param(
        "vtk",
        marks=[pytest.mark.render, pytest.mark.skipif(bool(renderer_missing()), reason=renderer_missing() or "-")],
    ),
]


def render(engine, q=None, extra=None, robot=None, **camera):
    """Depth image of an arm, a floor and a few bodies; those welded to the world and those that move."""
    params = CameraParameters(renderer=engine, **camera)
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    robot = robot or lwr4()
    arm = robot.add_to(plant)
    pose = RigidTransform(RollPitchYaw(0.3, 0.8, -0.4), [0.1, -0.5, 0.7])
    white = np.ones(4)
    world = plant.world_body()
    plant.RegisterVisualGeometry(world, RigidTransform(), HalfSpace(), "floor", white)
    plant.RegisterVisualGeometry(world, RigidTransform(CENTRE), Sphere(RADIUS), "ball", white)
    plant.RegisterVisualGeometry(world, pose, Box(0.1, 0.2, 0.3), "box", white)
    link = plant.GetBodyByName(robot.link_names[-1])
    plant.RegisterVisualGeometry(link, RigidTransform([0.0, 0.0, 0.15]), Cylinder(0.03, 0.1), "tool", white)
    plant.RegisterVisualGeometry(link, RigidTransform([0.1, 0.0, 0.1]), Capsule(0.02, 0.1), "grip", white)
    turned = RigidTransform(RollPitchYaw(1.0, 2.0, 3.0), [-0.1, 0.0, 0.1])
    plant.RegisterVisualGeometry(link, turned, Ellipsoid(0.02, 0.1, 0.05), "egg", white)
    table = plant.AddRigidBody("table", default_model_instance(), SpatialInertia.SolidBoxWithMass(1.0, 0.3, 0.2, 0.1))
    plant.WeldFrames(world.body_frame(), table.body_frame(), RigidTransform([0.4, 0.4, 0.3]))
    plant.RegisterVisualGeometry(table, RigidTransform([0.0, 0.1, 0.0]), Box(0.3, 0.2, 0.1), "table", white)
    if extra is not None:
        plant.RegisterVisualGeometry(link, RigidTransform(), extra, "extra", white)
    plant.Finalize()
    camera_system = add_depth_camera(builder, scene_graph, params)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), arm, robot.home if q is None else q)
    image = camera_system.GetOutputPort("depth_image_32f").Eval(camera_system.GetMyContextFromRoot(context))
    return params, image.data[..., 0].copy()


def sphere_depth(params):
    """Exact depth of the ball in each pixel (NaN beside it), and the squared cosine of its angle to the normal."""
    x, y = ray_tables(params)
    rays = np.stack([*np.meshgrid(x.astype(float), y.astype(float)), np.ones((params.height, params.width))], axis=-1)
    centre = camera_pose(params).inverse() @ CENTRE
    a, b = np.sum(rays * rays, axis=-1), rays @ centre
    root = b * b - a * (centre @ centre - RADIUS**2)
    margin = root / (a * RADIUS**2)  # 1 where the ray goes through the centre, 0 where it touches
    return (b - np.sqrt(np.where(root > 0.0, root, np.nan))) / a, margin


@pytest.mark.parametrize("engine", ENGINES)
def test_pixels_look_along_half_pixel_rays(engine):
    params, image = render(engine)
    exact, margin = sphere_depth(params)
    inner = margin > 0.1
    assert inner.sum() > 3000
    cosine = np.sqrt(margin[inner])  # of the angle between ray and normal: turns depth into distance from the surface
    error = cosine * np.abs(image[inner] - exact[inner])
    assert error.max() < 0.5e-3
    # With rays that are half a pixel off, the readings do not lie on the ball.
    half_off = CameraParameters(center_x=params.center[0] - 0.5, center_y=params.center[1] - 0.5)
    wrong, _ = sphere_depth(half_off)
    assert np.nanquantile(cosine * np.abs(image[inner] - wrong[inner]), 0.95) > 1.0e-3


@pytest.mark.parametrize("engine", ENGINES)
def test_floor_has_its_analytic_depth(engine):
    params, image = render(engine)
    X_WC = camera_pose(params)
    x, y = ray_tables(params)
    for row, column in ((470, 5), (475, 630), (400, 40)):
        ray = X_WC.rotation().matrix() @ [x[column], y[row], 1.0]
        depth = -X_WC.translation()[2] / ray[2]
        assert image[row, column] == pytest.approx(depth, abs=1e-3)


@pytest.mark.parametrize("engine", ENGINES)
def test_readings_out_of_range_are_zero_or_infinite(engine):
    _, image = render(engine, near=1.5, far=2.0)
    readings = image[(image > 0.0) & np.isfinite(image)]
    assert readings.min() >= 1.5 and readings.max() <= 2.0
    assert (image == 0.0).sum() > 1000
    assert np.isinf(image).sum() > 1000


@pytest.mark.parametrize("engine", ENGINES[1:])
@pytest.mark.parametrize("extra", [None, TETRAHEDRON])
@pytest.mark.parametrize("turn", [0.3, -0.2, 0.8])
def test_engines_agree(engine, extra, turn):
    """But for the triangles that VTK makes of round shapes, and a pixel at the outline of a shape."""
    q = lwr4().home + turn
    _, image = render(engine, q, extra)
    _, cast = render("raycast", q, extra)
    both = np.isfinite(image) & np.isfinite(cast)
    assert (np.isfinite(image) != np.isfinite(cast)).sum() < 40
    difference = np.abs(image[both] - cast[both])
    assert np.median(difference) < 1e-5
    assert np.quantile(difference, 0.99) < 0.5e-3
    assert (difference > 2e-3).sum() < 60


def test_auto_casts_rays_where_all_shapes_are_primitives():
    np.testing.assert_array_equal(render("auto")[1], render("raycast")[1])


def test_auto_casts_rays_at_meshes_without_vtk(monkeypatch):
    monkeypatch.setattr(rgbd_camera, "_renderer_problem", lambda: "no driver")
    np.testing.assert_array_equal(render("auto", extra=TETRAHEDRON)[1], render("raycast", extra=TETRAHEDRON)[1])


def test_a_shape_that_no_ray_can_meet_is_told():
    with pytest.raises(SensorError, match="extra.*cannot show a MeshcatCone"):
        render("raycast", extra=MeshcatCone(0.1, 0.1, 0.1))


needs_vtk = pytest.mark.skipif(bool(renderer_missing()), reason=renderer_missing() or "-")


@pytest.mark.render
@needs_vtk
def test_auto_takes_vtk_where_there_is_a_mesh():
    np.testing.assert_array_equal(render("auto", extra=TETRAHEDRON)[1], render("vtk", extra=TETRAHEDRON)[1])


def off_by_more_than_a_pixel(image, other, tolerance):
    """Count the pixels whose depth lies outside that of the 3×3 pixels there in another image."""
    rows, columns = image.shape
    padded = np.pad(other, 1, mode="edge")
    near = [padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)]
    return int(((image < np.min(near, axis=0) - tolerance) | (image > np.max(near, axis=0) + tolerance)).sum())


@pytest.mark.render
@needs_vtk
@pytest.mark.parametrize("name", ["lwr4", "omnirob"])
@pytest.mark.parametrize("position", [[-1.7, 0.0, 1.1], [-1.3, 0.8, 0.4], [-1.9, -0.7, 1.7]])
def test_exact_rays_see_what_vtk_sees(name, position):
    """Nothing of the one image is missing in the other, but for one pixel at outlines."""
    exact, vtk = (render(engine, robot=load(name), position=position)[1] for engine in ("raycast", "vtk"))
    assert off_by_more_than_a_pixel(exact, vtk, 2e-3) == 0
    assert off_by_more_than_a_pixel(vtk, exact, 2e-3) == 0


def test_camera_looks_at_its_target():
    params = CameraParameters(position=[1.0, -2.0, 0.5], target=[0.2, 0.3, 0.9])
    X_WC = camera_pose(params)
    x, y, z = X_WC.inverse() @ np.array(params.target)
    assert (x, y) == (pytest.approx(0.0, abs=1e-12), pytest.approx(0.0, abs=1e-12))
    assert z > 0.0
    assert X_WC.rotation().matrix()[2, 1] < 0.0  # y points down
    assert X_WC.rotation().matrix()[2, 0] == pytest.approx(0.0)  # x is level


@pytest.fixture
def fresh_probe():
    rgbd_camera._renderer_problem.cache_clear()
    yield
    rgbd_camera._renderer_problem.cache_clear()


def missing_library():
    raise OSError("libEGL.so.1: cannot open shared object file")


def crashed():
    return subprocess.CompletedProcess([], -11, "", "")


def test_missing_egl_library_names_its_package(monkeypatch, fresh_probe):
    monkeypatch.setattr(rgbd_camera, "_load_egl", missing_library)
    with pytest.raises(SensorError, match="libegl1"):
        render("vtk")


def test_crashing_driver_names_its_package_and_is_probed_once(monkeypatch, fresh_probe):
    calls = []
    monkeypatch.setattr(rgbd_camera, "_load_egl", lambda: None)
    monkeypatch.setattr(rgbd_camera, "_run_probe", lambda: calls.append(1) or crashed())
    for _ in range(2):
        with pytest.raises(SensorError, match="libgl1-mesa-dri"):
            check_renderer()
    assert len(calls) == 1


def test_missing_open3d_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without_open3d(name, *args, **kwargs):
        if name == "open3d":
            raise ImportError("no module")
        return real(name, *args, **kwargs)

    open3d_import.import_open3d.cache_clear()
    monkeypatch.setattr(builtins, "__import__", without_open3d)
    with pytest.raises(SensorError, match="open3d-cpu"):
        open3d_import.import_open3d()
    open3d_import.import_open3d.cache_clear()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("width", 0),
        ("focal_x", -1.0),
        ("near", 0.0),
        ("far", 0.3),
        ("rate", np.inf),
        ("center_x", 700.0),
        ("position", [0.0, 1.0]),
        ("target", [-1.7, 0.0, 0.0]),
    ],
)
def test_bad_parameters_are_named(field, value):
    with pytest.raises(ParameterError) as error:
        CameraParameters(**{field: value})
    assert error.value.field == field


def test_center_follows_the_size():
    params = CameraParameters()
    params.width = 320
    validate(params)
    assert params.center == (160.0, 240.0)
    assert CameraParameters(center_x=300.0).center == (300.0, 240.0)


def test_unknown_renderer_lists_those_that_exist():
    with pytest.raises(UnknownNameError, match="raycast"):
        CameraParameters(renderer="gl")
