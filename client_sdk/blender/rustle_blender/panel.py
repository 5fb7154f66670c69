"""The panel in the 3D view's sidebar."""
import bpy

from . import live
from .surroundings import collision_objects

CONTACT_RADIUS_M = 0.003


def hint(scene):
    """What keeps the sheet from being heard, where that can be told; empty: nothing."""
    settings = scene.rustle
    sheet = settings.sheet
    if sheet is None:
        return ""
    unit = (scene.unit_settings.scale_length if scene.unit_settings.system != "NONE" else 1.0) * settings.scale
    gaps = [modifier.collision_settings.distance_min for modifier in sheet.modifiers if modifier.type == "CLOTH"]
    obstacles = collision_objects(scene, sheet)
    if gaps and obstacles:
        gap_m = unit * (max(gaps) + max(item.collision.thickness_outer for item in obstacles))
        if gap_m > CONTACT_RADIUS_M:
            return f"Cloth stays {1000 * gap_m:.1f} mm away from obstacles; it is heard sliding within 3 mm. Lower the cloth's and the obstacles' distances."
    return ""


class RUSTLE_PT_panel(bpy.types.Panel):
    bl_idname, bl_label = "RUSTLE_PT_panel", "Rustle"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Rustle"

    def draw(self, context):
        layout, scene = self.layout, context.scene
        settings = scene.rustle
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        for name in ("sheet", "material", "surface", "listener", "scale", "floor"):
            column.prop(settings, name)
        obstacles = collision_objects(scene, settings.sheet)
        if obstacles:
            box = layout.box()
            box.label(text="Obstacles (collision objects)")
            for item in obstacles:
                box.prop(item, "rustle_surface", text=item.name)
        told = hint(scene)
        if told:
            self.paragraph(context, layout.box(), told, "INFO")
        column = layout.column()
        for name in ("channels", "seed", "control"):
            column.prop(settings, name)
        column.operator("rustle.ask", icon="FILE_REFRESH")
        self.draw_live(context, layout.box())
        box = layout.box()
        box.prop(settings, "output")
        if settings.progress > 0:
            box.prop(settings, "progress", slider=True)
        box.operator("rustle.bake", icon="SOUND")

    def draw_live(self, context, box):
        if live.running is None:
            box.operator("rustle.start", icon="PLAY_SOUND")
            if live.trouble:
                self.paragraph(context, box, live.trouble, "ERROR")
            return
        box.operator("rustle.stop", icon="PAUSE")
        box.label(text=f"{live.running.frames} frames, {1000 * live.running.median_cost_s():.2f} ms each")
        notice = live.running.sender.notice()
        if notice:
            self.paragraph(context, box, notice, "ERROR")

    @staticmethod
    def paragraph(context, box, text, icon):
        """A label does not break lines."""
        most = max(16, int(context.region.width / (8 * context.preferences.system.ui_scale)) - 8)  # letters in a line, about
        line = ""
        for word in text.split():
            if line and len(line) + len(word) > most:
                box.label(text=line, icon=icon)
                line, icon = "", "BLANK1"
            line += word + " "
        box.label(text=line, icon=icon)


def register():
    bpy.utils.register_class(RUSTLE_PT_panel)


def unregister():
    bpy.utils.unregister_class(RUSTLE_PT_panel)
