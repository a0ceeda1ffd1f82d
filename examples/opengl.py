"""An OpenGL renderer off-screen, frame by frame, by way of moderngl: python examples/opengl.py

A camera goes round a cube. Colour and depth are read back, turned so that row 0 is at the top, and handed over. Shader
and cltaa get the same matrices; only the shader's have the jitter.
"""

import sys
from typing import Any, cast

import moderngl
import numpy as np
from numpy.typing import NDArray

import cltaa

width, height, frames = (int(text) for text in sys.argv[1:] or ("320", "180", "24"))
near, far, focal = 0.1, 100.0, 2.0
projection = np.array([[focal * height / width, 0, 0, 0], [0, focal, 0, 0], [0, 0, 0, 0], [0, 0, -1, 0]])
projection[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)

off_screen: dict[str, Any] = {"standalone": True, "backend": "egl"}
context = moderngl.create_context(**off_screen)
context.enable(moderngl.DEPTH_TEST)
target = context.framebuffer([context.texture((width, height), 4, dtype="f4")], context.depth_texture((width, height)))
program = context.program(
    vertex_shader="""#version 330
        uniform mat4 to_clip; in vec3 place; out vec3 shade;
        void main() { gl_Position = to_clip * vec4(place, 1.0); shade = 0.55 + 0.45 * place; }""",
    fragment_shader="#version 330\nin vec3 shade; out vec4 colour; void main() { colour = vec4(shade, 1.0); }",
)
corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], "f4")
sides = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
cube = context.vertex_array(program, context.buffer(corners[sides[:, [0, 1, 2, 0, 2, 3]].ravel()].tobytes()), "place")


def draw(to_clip: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colour [H, W, 3] and depth [H, W] along the view axis."""
    cast(moderngl.Uniform, program["to_clip"]).write(to_clip.T.astype("f4").tobytes())  # OpenGL's columns lie in turn
    target.use()
    target.clear(0.02, 0.02, 0.03, depth=1.0)
    cube.render()
    colour = np.frombuffer(target.read(dtype="f4"), "f4").reshape(height, width, 3)[::-1]
    buffer = np.frombuffer(target.read(components=1, attachment=-1, dtype="f4"), "f4").reshape(height, width)[::-1]
    distance = 2 * far * near / (far + near - (2 * buffer - 1) * (far - near))
    return colour, np.where(buffer == 1, np.inf, distance).astype("f4")


samples = np.random.default_rng(0)
with cltaa.Resolver() as resolver:
    for index in range(frames):
        turn, x, y = np.radians(20 + 0.5 * index), *samples.uniform(-0.5, 0.5, 2)
        view, shift = np.eye(4), np.eye(4)
        view[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
        view[2, 3] = -5.0
        shift[:2, 3] = -2 * x / width, 2 * y / height  # the image moves opposite to the sample; y is up there
        colour, depth = draw(shift @ projection @ view)
        image = resolver.resolve(cltaa.Frame(index, colour, depth, cltaa.Camera(view, projection), (x, y)))
print(f"{frames} frames; they differ by {np.abs(image - colour).mean():.4f} from what was drawn last")
