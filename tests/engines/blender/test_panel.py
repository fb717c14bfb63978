"""What the panel draws, and what the timer does.

bpy as a module has no window, so that Blender cannot call `draw` or the timer; the tests call them.
"""

import bpy
import pytest
from bl_ext.user_default.lightprobe import panel, session
from probes import Probe, packet, ticked_until


class Layout:
    """Takes down what is drawn. Asks Blender itself whether properties and operators exist."""

    def __init__(self, drawn):
        self.drawn = drawn

    def row(self, align=False):
        return self

    box = column = row

    def separator(self):
        pass

    def label(self, text, icon):
        assert icon in bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items
        self.drawn.append(text)

    def prop(self, settings, name):
        self.drawn.append(settings.bl_rna.properties[name].name)

    def operator(self, name):
        group, _, short = name.partition(".")
        self.drawn.append(getattr(getattr(bpy.ops, group), short).get_rna_type().name)


def drawn():
    """All texts of the panel."""

    class Shown:
        layout = Layout([])

    panel.LightprobePanel.draw(Shown, bpy.context)
    return Shown.layout.drawn


@pytest.mark.parametrize(("mode", "lamps"), [("LAMPS", True), ("MAP", False)])
def test_the_panel_shows_settings_and_state(scene, mode, lamps):
    scene.lightprobe.mode = mode
    texts = drawn()
    assert {"Probe", "Connect", "Disconnect", "Keyframe a recording", "Scale"} <= set(texts)
    for name in ("Lamps", "Lit object", "Point lights"):
        assert (name in texts) == lamps
    assert session.state().headline in texts


def test_the_panel_says_how_the_light_is(scene):
    with Probe() as probe:
        scene.lightprobe.uri = probe.uri
        bpy.ops.lightprobe.connect()
        probe.send(packet(lamps=[(1, (0, 1, 0), (2, 2, 2), 1)]))
        running = session.current()
        ticked_until(running, lambda: running.report.state == "FRESH", "no light")
        texts = drawn()
        assert "test probe: 1 lamp" in texts
        # Long sentences are broken into lines.
        assert any(text.startswith("World: from the SH, because") for text in texts)


def test_the_timer_goes_on_until_disconnect(scene):
    with Probe() as probe:
        scene.lightprobe.uri = probe.uri
        bpy.ops.lightprobe.connect()
        assert bpy.app.timers.is_registered(session._on_timer)
        assert session._on_timer() == session.TICK_S
        bpy.ops.lightprobe.disconnect()
        assert session._on_timer() is None


def test_a_deleted_scene_ends_the_session(scene):
    with Probe() as probe:
        other = bpy.data.scenes.new("other")
        other.lightprobe.uri = probe.uri
        session.connect(other)
        bpy.data.scenes.remove(other)
        assert session._on_timer() is None
        assert session.state().headline == "not connected: the scene was deleted"
