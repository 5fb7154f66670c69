"""What a scene says about its sheet and its sound."""
import bpy

materials = []  #: that the daemon offered when it was asked last


def _is_mesh(_, item):
    return item.type == "MESH"


def _can_listen(_, item):
    return item.type in ("CAMERA", "EMPTY")


def _offered(_self, _context, text):
    return [name for name in materials if text.lower() in name.lower()]


class RustleSettings(bpy.types.PropertyGroup):
    sheet: bpy.props.PointerProperty(type=bpy.types.Object, poll=_is_mesh, name="Sheet", description="The mesh object that is heard")
    material: bpy.props.StringProperty(name="Material", search=_offered, search_options={"SORT", "SUGGESTION"},
                                       description="A sound pack's material; empty: printer-paper. Ask Daemon fills the list")
    surface: bpy.props.StringProperty(name="Touches", description="What the sheet touches where an obstacle does not say; empty: wooden-table")
    listener: bpy.props.PointerProperty(type=bpy.types.Object, poll=_can_listen, name="Listener",
                                        description="A camera or an empty that hears, looking along its -Z; empty: the scene's camera")
    scale: bpy.props.FloatProperty(name="Scale", default=1.0, min=1e-6, max=1e6,
                                   description="Of a sheet that is simulated larger than life: 0.1 where it is ten times as large")
    floor: bpy.props.BoolProperty(name="Floor at Z = 0", description="An endless floor that the sheet can touch and that reflects its sound")
    seed: bpy.props.IntProperty(name="Seed", min=0, description="Of everything random in the sound")
    channels: bpy.props.EnumProperty(name="Channels", default="stereo", items=[
        ("mono", "Mono", ""), ("stereo", "Stereo", ""), ("binaural", "Binaural", "For headphones")])
    control: bpy.props.StringProperty(name="Daemon", default="tcp://127.0.0.1:7390", description="The control endpoint that rustled prints when it starts")
    output: bpy.props.StringProperty(name="WAV", default="//rustle.wav", subtype="FILE_PATH", description="Where the baked sound is written")
    progress: bpy.props.FloatProperty(name="Baking", subtype="PERCENTAGE", min=0, max=100, options={"SKIP_SAVE"})


def register():
    bpy.utils.register_class(RustleSettings)
    bpy.types.Scene.rustle = bpy.props.PointerProperty(type=RustleSettings)
    bpy.types.Object.rustle_surface = bpy.props.StringProperty(name="Surface", description="What the obstacle is made of, as packs name it: wooden-table")


def unregister():
    del bpy.types.Object.rustle_surface
    del bpy.types.Scene.rustle
    bpy.utils.unregister_class(RustleSettings)
