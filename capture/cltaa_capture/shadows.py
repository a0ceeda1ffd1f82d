"""Shadow maps: the depth of a scene from a sun, drawn once per instant, only if a sun casts shadows.

Reeves et al., "Rendering Antialiased Shadows with Depth Maps" (1987), with two by two comparisons filtered bilinearly.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from OpenGL import GL

from cltaa.errors import InternalError, ResourceError
from cltaa.frame import Matrix
from cltaa_capture.cameras import reversed_projection
from cltaa_datasets.animation import look_at
from cltaa_datasets.scene import Instant, Light, Orthographic, Shadow, Sun

UNIT = 3  # texture unit of the map, after those of a material
# The lookup is offset by this many texels along the surface normal: more than half a texel's diagonal.
OFFSET_TEXELS = 2.0


def casting_sun(lights: Sequence[Light]) -> tuple[int, Sun, Shadow] | None:
    """Return the sun that casts shadows and its index among the suns; raises InternalError for several."""
    suns = [light for light in lights if isinstance(light, Sun)]
    casting = [(place, sun, sun.shadow) for place, sun in enumerate(suns) if sun.shadow is not None]
    if len(casting) > 1:
        raise InternalError(f"{len(casting)} suns cast shadows", expected="one at most")
    return casting[0] if casting else None


def world_to_shadow(sun: Sun, shadow: Shadow) -> Matrix:
    """Return the matrix from world to the map's clip space, float64, with reversed depth; the ball around
    ``shadow.centre`` fills it."""
    centre, towards = np.asarray(shadow.centre, np.float64), np.asarray(sun.direction, np.float64)
    up = (1.0, 0.0, 0.0) if abs(towards[1]) > 0.9 else (0.0, 1.0, 0.0)
    eye = centre + shadow.radius * towards
    view = look_at(tuple(eye.tolist()), tuple(centre.tolist()), up)
    return reversed_projection(Orthographic(shadow.radius, 0.0, 2.0 * shadow.radius), 1.0) @ view


def shadow_uniforms(now: Instant) -> dict[str, Any]:
    """Return the uniforms for a lookup in the map; empty if no sun casts shadows."""
    found = casting_sun(now.lights)
    if found is None:
        return {}
    _, sun, shadow = found
    view_to_world = np.linalg.inv(now.world_to_view)
    offset = OFFSET_TEXELS * 2.0 * shadow.radius / shadow.texels
    return {
        "view_to_shadow": np.ascontiguousarray(world_to_shadow(sun, shadow) @ view_to_world, np.float32),
        "shadow_offset": offset,
        "shadow_map": UNIT,
    }


class ShadowMap:
    """A square depth texture with comparison, and the framebuffer that draws into it."""

    def __init__(self, texels: int) -> None:
        """Allocate; raises ResourceError if the driver refuses."""
        self.texels = texels
        self._framebuffer, self._texture = GL.glGenFramebuffers(1), GL.glGenTextures(1)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)
        depth = GL.GL_DEPTH_COMPONENT32F
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, depth, texels, texels, 0, GL.GL_DEPTH_COMPONENT, GL.GL_FLOAT, None)
        for parameter, value in (
            (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
            (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
            (GL.GL_TEXTURE_WRAP_S, GL.GL_CLAMP_TO_BORDER),
            (GL.GL_TEXTURE_WRAP_T, GL.GL_CLAMP_TO_BORDER),  # the border is 0, the farthest depth: lit
            (GL.GL_TEXTURE_COMPARE_MODE, GL.GL_COMPARE_REF_TO_TEXTURE),
            (GL.GL_TEXTURE_COMPARE_FUNC, GL.GL_GEQUAL),  # reversed depth: lit if as near to the sun or nearer
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, parameter, value)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        attachment = GL.GL_DEPTH_ATTACHMENT
        GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, attachment, GL.GL_TEXTURE_2D, self._texture, 0)
        GL.glDrawBuffer(GL.GL_NONE)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise ResourceError(
                f"OpenGL refuses a shadow map of {texels}x{texels}", cure="give the scene a smaller one"
            )

    def begin(self) -> None:
        """Clear the map and direct drawing into it."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        GL.glViewport(0, 0, self.texels, self.texels)
        GL.glDepthMask(GL.GL_TRUE)
        GL.glDisable(GL.GL_BLEND)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glClearBufferfv(GL.GL_DEPTH, 0, np.zeros(1, np.float32))

    def bind(self) -> None:
        """Bind the map for shaders."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + UNIT)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)

    def delete(self) -> None:
        """Free the map."""
        GL.glDeleteFramebuffers(1, [self._framebuffer])
        GL.glDeleteTextures([self._texture])
