"""Draw one instant of a scene: linear float32 colour, planar depth, and motion if the scene declares it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pyrender
from OpenGL import GL

from cltaa.frame import Effect, Frame, Image
from cltaa_capture.cameras import camera_at, planar_depth
from cltaa_capture.jitter import Offsets
from cltaa_capture.programs import ProgramShelf, Uniforms
from cltaa_capture.shadows import ShadowMap
from cltaa_capture.stage import Placed, Staged, jitter_uniforms, stage
from cltaa_capture.targets import Readback, Target, use_reversed_depth
from cltaa_capture.upload import Drawable, upload
from cltaa_datasets.scene import Instant, Scene, Shadow

# Output of a target -> effect that needs it; colour is always drawn.
SHADOW_DEFINES = ("TEXCOORD_SLOT", "MASK", "BASE_TEXTURE")  # defines of shadow.vert and shadow.frag
CALLED_FOR_BY = {"motion": Effect.MOTION, "reactive": Effect.REACTIVE}


@dataclass(frozen=True, eq=False, slots=True)
class Drawn:
    """One sample a pixel of one instant, row 0 at the top; None for channels that the scene does not need."""

    colour: Image  # [H, W, 4], premultiplied, alpha last
    depth: Image  # [H, W], planar, +inf where nothing was drawn
    motion: Image | None  # [H, W, 2], pixels, y down, NaN where only the camera moves
    reactive: Image | None  # [H, W], share of the colour without depth and motion

    def frame(self, scene: Scene, now: Instant, *, index: int, jitter_px: tuple[float, float], cut: bool) -> Frame:
        """Return a frame of ``scene``, with the channels that its effects need."""
        height, width = self.depth.shape
        return Frame(
            index=index,
            colour=np.ascontiguousarray(self.colour[..., :3]),
            depth=self.depth,
            camera=camera_at(now, width / height),
            jitter_px=jitter_px,
            motion=self.motion,
            alpha=np.ascontiguousarray(self.colour[..., 3]) if Effect.ALPHA in scene.effects else None,
            reactive=self.reactive,
            cut=cut,
            exposure=now.exposure,
            scene=scene.name,
            effects=scene.effects,
        )


class SceneRenderer(pyrender.Renderer):  # type: ignore[misc]
    """Draws the instants of one scene, uploaded once; needs a current context (``open_context``).

    pyrender holds meshes and textures in the context; this package has its own shaders, targets and drawing.
    """

    def __init__(self, scene: Scene, width: int, height: int) -> None:
        """Upload ``scene`` and allocate a picture of ``width`` x ``height`` pixels."""
        super().__init__(width, height)
        self._scene, self._size = scene, (width, height)
        self._programs = ProgramShelf()
        self._target = Target(width, height, ["colour", *(o for o, e in CALLED_FOR_BY.items() if e in scene.effects)])
        self._colour_target = Target(width, height, ["colour"])
        use_reversed_depth()
        holder, self._drawables = upload(scene)
        self._update_context(holder, pyrender.RenderFlags.NONE)
        self._no_vertices = GL.glGenVertexArrays(1)
        self._shadow_map: ShadowMap | None = None
        self._readback: Readback | None = None

    def delete(self) -> None:
        """Free all resources of this renderer in the context."""
        self._programs.delete()
        self._free_shadow_map()
        GL.glDeleteVertexArrays(1, [self._no_vertices])
        super().delete()

    def __del__(self) -> None:
        """Do nothing: pyrender's own ``__del__`` would free the same names again, in any context current by then."""

    def _delete_main_framebuffer(self) -> None:
        # Called by pyrender's delete, whose own framebuffer is never created.
        self._target.delete()
        self._colour_target.delete()
        if self._readback is not None:
            self._readback.delete()

    def draw(self, now: Instant, before: Instant, jitter_px: tuple[float, float]) -> Drawn:
        """Draw ``now`` with one sample a pixel; motion leads to ``before``."""
        target = self._target
        self._paint(target, self._stage(now, before), jitter_px)
        return Drawn(
            colour=target.read("colour"),
            depth=planar_depth(target.read_depth(), now.lens),
            motion=target.read("motion") if "motion" in target.outputs else None,
            reactive=target.read("reactive") if "reactive" in target.outputs else None,
        )

    def draw_reference(self, now: Instant, offsets: Offsets) -> Image:
        """Draw the mean of the samples at ``offsets`` [N, 2] pixels: colour [H, W, 4], summed in float64."""
        staged = self._stage(now, now)
        total = np.zeros((self._size[1], self._size[0], 4))
        if self._readback is None:
            self._readback = Readback(self._colour_target, "colour")
        drawings = (partial(self._paint, self._colour_target, staged, tuple(offset)) for offset in offsets.tolist())
        for pixels in self._readback.each(drawings):
            total += pixels
        return np.asarray(total / len(offsets), np.float32)

    def _stage(self, now: Instant, before: Instant) -> Staged:
        """Compose an instant and upload the data that all its drawings share."""
        staged = stage(self._scene, self._drawables, now, before, self._size)
        for item in (*staged.solid, *staged.glassy):
            if item.vertices is not None and item.drawable.vertices is not None:
                item.drawable.vertices.fill(item.vertices)
        if staged.shadow is not None:
            self._draw_shadow(staged, staged.shadow)
        return staged

    def _draw_shadow(self, staged: Staged, shadow: Shadow) -> None:
        """Draw the shadow casters from the sun, once for all samples of an instant."""
        if self._shadow_map is None or self._shadow_map.texels != shadow.texels:
            self._free_shadow_map()
            self._shadow_map = ShadowMap(shadow.texels)
        self._shadow_map.begin()
        for item in staged.solid:
            drawable = item.drawable
            wanted = {k: v for k, v in drawable.defines.items() if k in SHADOW_DEFINES}
            self._bind_textures(drawable)
            self._programs.get("shadow.vert", "shadow.frag", wanted).bind(item.uniforms, drawable.uniforms)
            self._draw_elements(drawable)
        self._shadow_map.bind()

    def _free_shadow_map(self) -> None:
        if self._shadow_map is not None:
            self._shadow_map.delete()
            self._shadow_map = None

    def _paint(self, target: Target, staged: Staged, jitter_px: tuple[float, float]) -> None:
        """Draw into ``target``: solid parts, then the sky behind them, then translucent parts."""
        outputs = {output.upper(): place for place, output in enumerate(target.outputs) if place > 0}
        jitter = jitter_uniforms(jitter_px, self._size)
        target.begin()
        GL.glDisable(GL.GL_BLEND)
        self._draw_parts(staged.solid, staged.defines | outputs, (staged.uniforms, jitter))
        if staged.has_sky:
            self._draw_sky(outputs, (staged.uniforms, jitter))
        if staged.glassy:
            # Premultiplied colour over the solid parts, whose depth and motion stay.
            GL.glEnable(GL.GL_BLEND)
            GL.glBlendFunc(GL.GL_ONE, GL.GL_ONE_MINUS_SRC_ALPHA)
            target.keep_geometry(True)
            self._draw_parts(staged.glassy, staged.defines | outputs, (staged.uniforms, jitter))
            target.keep_geometry(False)

    def _draw_parts(self, items: Iterable[Placed], defines: dict[str, int], frame: tuple[Uniforms, ...]) -> None:
        for item in items:
            drawable = item.drawable
            moving = {"MOVING": 1} if item.moves and "MOTION" in defines else {}
            self._bind_textures(drawable)
            program = self._programs.get("mesh.vert", "mesh.frag", defines | drawable.defines | moving)
            program.bind(item.uniforms, drawable.uniforms, *frame)
            (GL.glDisable if drawable.part.material.double_sided else GL.glEnable)(GL.GL_CULL_FACE)
            # A mirroring pose reverses the winding of triangles (glTF 2.0 section 3.7.4).
            GL.glFrontFace(GL.GL_CW if item.mirrored else GL.GL_CCW)
            self._draw_elements(drawable)

    def _bind_textures(self, drawable: Drawable) -> None:
        for unit, texels in enumerate(drawable.textures):
            GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
            texels._bind()

    def _draw_elements(self, drawable: Drawable) -> None:
        drawable.primitive._bind()
        GL.glDrawElements(GL.GL_TRIANGLES, drawable.primitive.indices.size, GL.GL_UNSIGNED_INT, None)

    def _draw_sky(self, outputs: dict[str, int], frame: tuple[Uniforms, ...]) -> None:
        stars = {"STARS": 1} if frame[0]["stars"] > 0.0 else {}
        self._programs.get("sky.vert", "sky.frag", outputs | stars).bind(*frame)
        GL.glDisable(GL.GL_CULL_FACE)
        # Reversed depth at infinity equals the cleared 0, so only "greater or equal" draws the sky.
        GL.glDepthFunc(GL.GL_GEQUAL)
        GL.glBindVertexArray(self._no_vertices)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        GL.glDepthFunc(GL.GL_GREATER)
