"""What is seen has the bodies of the physics, whole surfaces, and few of them; the physics knows nothing of it."""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from juicer.errors import ConfigError
from juicer.imaging.look import Look
from juicer.imaging.panda_mesh import PACKAGE, VERSION, has_panda_mesh
from juicer.imaging.parts import painted_surfaces
from juicer.imaging.surfaces import ridge
from juicer.imaging.visual_model import visual_model
from juicer.sim.env import AssemblyEnv
from juicer.tasks.registry import get_task
from juicer.tasks.square_table import square_table_top
from juicer.views import View

TASKS = ("one_leg", "round_table", "lamp", "square_table")
TETRAHEDRON = "v 0 0 0\nv .05 0 0\nv 0 .05 0\nv 0 0 .05\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("task", TASKS)
def test_bodies_are_where_those_of_the_physics_are(task: str):
    with AssemblyEnv(task) as env:
        env.reset(seed=1)
        model = visual_model(task, Look())
        data = mujoco.MjData(model)
        data.qpos[:] = env.data.qpos
        mujoco.mj_kinematics(model, data)
        names = [env.model.body(index).name for index in range(env.model.nbody)]
        assert [model.body(index).name for index in range(model.nbody)] == names
        np.testing.assert_array_equal(data.xpos, env.data.xpos)
        np.testing.assert_array_equal(data.xquat, env.data.xquat)


@pytest.mark.parametrize("task", TASKS)
def test_a_part_is_a_few_geoms_that_touch_nothing(task: str):
    model = visual_model(task, Look())
    assert model.ngeom < 40
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


@pytest.mark.parametrize("task", TASKS)
def test_every_triangle_is_seen_from_where_its_normals_point(task: str):
    for part in get_task(task).parts:
        for _, surface in painted_surfaces(part):
            first, second, third = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
            facing = np.cross(second - first, third - first)
            np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1)
            assert np.all(np.sum(facing[:, None] * surface.normals[surface.faces], axis=2) > 0)


def test_a_thread_is_a_ridge_along_its_helix():
    thread = square_table_top().threads[0]
    points = ridge(thread).vertices - (thread.center_xz[0], 0, thread.center_xz[1])
    radius = np.hypot(points[:, 0], points[:, 2])
    # Its crest reaches inwards from the wall that it lies on, and it rises by its pitch a turn.
    assert radius.min() == pytest.approx(thread.helix_radius - thread.bead_radius)
    middle = points[:, 1].min() + thread.bead_radius, points[:, 1].max() - thread.bead_radius
    np.testing.assert_allclose(
        middle, (thread.start_y, thread.start_y + thread.turns * thread.pitch), atol=thread.bead_radius / 50
    )


@pytest.mark.usefixtures("drawing")
@pytest.mark.skipif(has_panda_mesh(), reason="the robot's mesh is installed here")
def test_a_robot_s_mesh_that_is_not_installed_is_named_with_the_command_that_installs_it():
    with AssemblyEnv() as env:
        env.reset(seed=0)
        with pytest.raises(ConfigError, match=r"dm-robotics-panda .*not installed.*`make looks`"):
            env.render_view(View(camera="front", robot="mesh"))


@pytest.mark.usefixtures("drawing")
def test_the_robot_s_mesh_is_read_as_data_and_its_package_never_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    install_a_panda(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    has_panda_mesh.cache_clear()
    visual_model.cache_clear()
    try:
        with AssemblyEnv() as env:
            env.reset(seed=0)
            plain = env.render_view(View(camera="front"))
            assert np.any(env.render_view(View(camera="front", robot="mesh")) != plain)
            assert np.any(env.render_camera("front", 96, 96) != plain)
            np.testing.assert_array_equal(env.render_view(View(camera="front")), plain)
    finally:
        has_panda_mesh.cache_clear()
        visual_model.cache_clear()
    assert "dm_robotics" not in sys.modules


@pytest.mark.usefixtures("drawing")
def test_a_damaged_mesh_is_told_in_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assets = install_a_panda(tmp_path)
    (assets / "link3.obj").write_text("no mesh")
    monkeypatch.syspath_prepend(tmp_path)
    has_panda_mesh.cache_clear()
    try:
        with AssemblyEnv() as env:
            env.reset(seed=0)
            with pytest.raises(ConfigError, match=r"robot's mesh cannot be read.*`make looks`"):
                env.render_view(View(camera="front", robot="mesh"))
    finally:
        has_panda_mesh.cache_clear()


def install_a_panda(folder: Path) -> Path:
    """A package that looks like the real one, and must not be imported."""
    assets = folder / "dm_robotics" / "panda" / "assets" / "panda"
    assets.mkdir(parents=True)
    (folder / "dm_robotics" / "__init__.py").write_text("raise SystemExit('imported')")
    for name in (*(f"link{number}" for number in range(8)), "hand", "finger"):
        (assets / f"{name}.obj").write_text(TETRAHEDRON)
    from PIL import Image

    Image.new("RGB", (4, 4), (200, 30, 30)).save(assets / "panda.png")
    information = folder / f"dm_robotics_panda-{VERSION}.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {PACKAGE}\nVersion: {VERSION}\n")
    return assets
