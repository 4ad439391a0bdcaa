# SPDX-License-Identifier: Apache-2.0
"""A user's session in Blender, as JSON: runs where `import bpy` does (.venv-dcc).

python blender_session.py ZIP STAGE IMAGE COMMAND FOLDER
"""

import json
import math
import os
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp()  # before Blender starts

import bpy

ZIP, STAGE, IMAGE, COMMAND, FOLDER = sys.argv[1:]
ADDON = "bl_ext.user_default.asglight"


def main() -> None:
    found = {}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        filepath=ZIP, repo="user_default", enable_on_install=True
    )
    found["enabled"] = ADDON in bpy.context.preferences.addons
    found["handler"] = bpy.types.FileHandler.bl_rna_get_subclass_py("ASGLIGHT_FH_stage").__name__
    found["dropped"] = dropping()
    found |= importing()
    found |= warnings()
    found |= saving()
    found |= fitting()
    found["left"] = leaving()
    (Path(FOLDER) / "session.json").write_text(json.dumps(found))
    bpy.ops.preferences.addon_disable(module=ADDON)


def dropping() -> list[str]:
    """Return what is asked for a stage that is dropped on a window, of which there is none here."""
    from bl_ext.user_default.asglight.importing import ASGLIGHT_OT_import

    asked: list[str] = []

    def dialog(operator: object, *, title: str, confirm_text: str) -> set[str]:
        asked.extend((title, confirm_text))
        return {"RUNNING_MODAL"}

    manager = SimpleNamespace(invoke_props_dialog=dialog)
    dropped = SimpleNamespace(filepath=STAGE)
    context = SimpleNamespace(window_manager=manager)
    assert ASGLIGHT_OT_import.invoke(dropped, context, None) == {"RUNNING_MODAL"}
    return asked


def importing() -> dict[str, object]:
    scene = bpy.context.scene
    bpy.ops.import_scene.asglight(filepath=STAGE, distance=20.0, offset=100)
    lights, lobes, rig = parts()
    found: dict[str, object] = {"names": sorted(one.name for one in (*lights, *lobes))}
    found["hidden"] = sorted(one.name for one in lobes if one.hide_render)
    found["distances"] = [one.matrix_world.translation.length for one in lights]
    found["range"] = [scene.frame_start, scene.frame_end, scene.render.fps]
    found["world"] = scene.world.name
    found["collections"] = sorted({one.users_collection[0].name for one in (*lights, rig)})
    energy = lights[0].data.energy
    lobe = lights[0].parent
    lobe["gain"] = 2.5
    lobe.name = "my sun"
    lights[-1].hide_render = True
    other = bpy.data.collections.new("mine")
    scene.collection.children.link(other)
    other.objects.link(lights[0])
    count = len(bpy.data.objects)
    bpy.ops.import_scene.asglight(filepath=STAGE, distance=40.0, offset=100)
    scene.frame_set(scene.frame_current)
    found["again"] = {
        "objects": len(bpy.data.objects) - count,
        "name": lobe.name,
        "gain": lobe["gain"],
        "energy": lights[0].data.energy / energy,
        "linked": lights[0].name in other.objects,
        "hidden": lights[-1].hide_render,
        "distance": lights[0].matrix_world.translation.length,
    }
    found["blinking"] = blinking()
    found["handed"] = [handed()]
    bpy.ops.import_scene.asglight(
        filepath=STAGE, distance=40.0, offset=100, use_world=False, set_time=False, seen=True
    )
    found["handed"].append(handed())
    path = f"{FOLDER}/saved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    lights, _, _ = parts()
    mine = next(one for one in lights if one.parent.name == "my sun")
    found["opened"] = mine.data.energy / energy
    found["refused"] = refused(bpy.ops.import_scene.asglight, STAGE, representation="dome")
    other = Path(FOLDER) / "other.usda"
    other.write_text('#usda 1.0\ndef RectLight "lamp" {}\n')
    found["other"] = refused(bpy.ops.import_scene.asglight, str(other))
    found["absent"] = refused(bpy.ops.import_scene.asglight, f"{FOLDER}/absent.usda")
    return found


def blinking() -> list[list[bool]]:
    """Return what is hidden while a version of the stage hides all, and with the next one."""
    from pxr import Usd, UsdGeom, UsdLux

    stage = Usd.Stage.Open(STAGE)
    stage.SetEditTarget(stage.GetSessionLayer())
    for prim in stage.Traverse():
        if prim.HasAPI(UsdLux.LightAPI):
            UsdGeom.Imageable(prim).MakeInvisible()
    dark = f"{FOLDER}/dark.usda"
    stage.Export(dark)
    lights, _, rig = parts()
    found = []
    for version in (dark, STAGE):
        bpy.ops.import_scene.asglight(filepath=version, rig=rig.name, distance=40.0, offset=100)
        found.append([one.hide_render for one in lights])
    return found


def handed() -> list[bool]:
    """Return what the panel's button hands over to the importer, of which there is none here."""
    from bl_ext.user_default.asglight.panel import ASGLIGHT_PT_rigs

    _, _, rig = parts()
    buttons = {}
    layout = SimpleNamespace(label=lambda **_: None, prop=lambda *_, **__: None)
    layout.box = layout.row = layout.column = lambda **_: layout
    layout.operator = lambda name, **_: buttons.setdefault(name, SimpleNamespace())
    ASGLIGHT_PT_rigs._rig(SimpleNamespace(layout=layout), rig)
    again = buttons["import_scene.asglight"]
    return [again.use_world, again.set_time, again.seen]


def warnings() -> dict[str, object]:
    """Import what Blender cannot show as it is, and return what is said."""
    from bl_ext.user_default.asglight import worlds
    from bl_ext.user_default.asglight.plain.rigs import opened, read_rig, rig_prims
    from bl_ext.user_default.asglight.reading import Warned

    text = Path(STAGE).read_text()
    text = text.replace('def RectLight "tall"', 'def SphereLight "tall"')
    image = "asset inputs:texture:file = @a.exr@"
    text = text.replace("bool inputs:normalize", f"{image}\nbool inputs:normalize")
    warned = Warned()
    path = Path(FOLDER) / "odd.usda"
    for space in ("lin_adobergb_scene", "lin_ciexyzd65_scene"):
        path.write_text(text.replace("lin_rec709_scene", space))
        stage = opened(str(path))
        warned.about(read_rig(rig_prims(stage)[0]))
    scene = bpy.data.scenes.new("greys")
    greys = [worlds.show_nothing_grey(scene)]
    for colour in (0.05, 0.0509, 0.2):
        scene.world = bpy.data.worlds.new("grey")
        scene.world.color = (colour, colour, colour)
        greys += [worlds.show_nothing_grey(scene), scene.world.color[0]]
    bpy.data.scenes.remove(scene)
    return {"warned": warned.lines, "greys": greys}


def saving() -> dict[str, object]:
    lights, _, rig = parts()
    for light in lights:
        light.parent["gain"] = 1.0
        light.hide_render = False
    found = {"unchanged": refused(bpy.ops.asglight.save_edits, f"{FOLDER}/none.usda")}
    found["over"] = refused(bpy.ops.asglight.save_edits, STAGE)
    lights[0].data.type = "POINT"
    found["point"] = refused(bpy.ops.asglight.save_edits, f"{FOLDER}/none.usda")
    lights[0].data.type = "AREA"
    lights[0].data.shape = "RECTANGLE"
    rig["asglight_strength"] = 0.0
    found["dark"] = refused(bpy.ops.asglight.save_edits, f"{FOLDER}/none.usda")
    rig["asglight_strength"] = 1.0
    lights[0].parent["gain"] = 2.0
    lights[1].scale = (1.5, 1.0, 1.0)
    rig.rotation_euler.z = math.radians(30)
    bpy.ops.asglight.save_edits(filepath=f"{FOLDER}/edits.usda")
    return found


def fitting() -> dict[str, object]:
    scene = bpy.context.scene
    world = bpy.data.worlds.new("HDRI")
    scene.world = world
    world.use_nodes = True
    tree = world.node_tree
    image = tree.nodes.new("ShaderNodeTexEnvironment")
    found = {"no image": bpy.ops.asglight.fit_world.poll()}
    image.image = bpy.data.images.load(IMAGE)
    background = tree.nodes["Background"]
    tree.links.new(image.outputs[0], background.inputs[0])
    background.inputs["Strength"].default_value = 3.0
    stage = f"{FOLDER}/fitted.usda"
    found["no command"] = refused(bpy.ops.asglight.fit_world, stage)
    preferences = bpy.context.preferences.addons[ADDON].preferences
    preferences.command = COMMAND
    image.projection = "MIRROR_BALL"
    found["ball"] = refused(bpy.ops.asglight.fit_world, stage)
    image.projection = "EQUIRECTANGULAR"
    image.image.pack()
    found["packed"] = refused(bpy.ops.asglight.fit_world, stage)
    image.image.unpack(method="REMOVE")
    image.image = bpy.data.images.load(IMAGE)
    mapping = tree.nodes.new("ShaderNodeMapping")
    tree.links.new(mapping.outputs[0], image.inputs["Vector"])
    mapping.inputs["Rotation"].default_value = (0.1, 0, 0)
    found["tilted"] = refused(bpy.ops.asglight.fit_world, stage)
    mapping.vector_type = "NORMAL"
    found["normal"] = refused(bpy.ops.asglight.fit_world, stage)
    tree.nodes.remove(mapping)
    gamma = tree.nodes.new("ShaderNodeGamma")
    tree.links.new(image.outputs[0], gamma.inputs[0])
    tree.links.new(gamma.outputs[0], background.inputs[0])
    found["changed"] = refused(bpy.ops.asglight.fit_world, stage)
    tree.links.new(image.outputs[0], background.inputs[0])
    found["failed"] = refused(bpy.ops.asglight.fit_world, f"{FOLDER}/no folder/fitted.usda")
    found["fitted"] = refused(bpy.ops.asglight.fit_world, stage, keys="auto")
    rig = next(one for one in scene.objects if one.get("asglight_stage") == stage)
    found["turn"] = math.degrees(rig.rotation_euler.z)
    found["strength"] = rig["asglight_strength"]
    found["world after"] = scene.world.name
    return found


def leaving() -> list[bool]:
    """Open another file while a fit runs, as with a window; return whether it ran, and ended."""
    from bl_ext.user_default.asglight import fitting

    runs = []

    def started(_: list[str]) -> fitting.Run:
        runs.append(fitting_run([sys.executable, "-c", "import time; time.sleep(60)"]))
        return runs[0]

    fitting_run, fitting.Run = fitting.Run, started
    fitting.bpy = SimpleNamespace(app=SimpleNamespace(background=False), path=bpy.path)
    bpy.ops.asglight.fit_world(filepath=f"{FOLDER}/left.usda")
    ran = runs[0].poll() is None
    bpy.ops.wm.read_homefile(use_empty=True)
    return [ran, runs[0].poll() is not None]


def parts() -> tuple[list, list, bpy.types.Object]:
    """Return lights, empties of lobes, and the rig."""
    objects = [one for one in bpy.context.scene.objects if "asglight_prim" in one]
    lights = sorted((one for one in objects if one.type == "LIGHT"), key=lambda one: one.name)
    lobes = [one for one in objects if one.type == "EMPTY" and one.parent]
    return lights, lobes, next(one for one in objects if one.parent is None)


def refused(operator: object, path: str, **settings: object) -> str:
    """Return what an operator says that does nothing."""
    try:
        done = operator(filepath=path, **settings)
    except RuntimeError as error:
        return str(error).strip()
    return ", ".join(done)


main()
