"""Shader programs: GLSL files specialised by ``#define`` lines, with every uniform bound by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

from OpenGL import GL

from cltaa.errors import InternalError

Defines = Mapping[str, int]
Uniforms = Mapping[str, Any]

SHADERS = files("cltaa_capture") / "shaders"

# GLSL type -> call that sets one uniform; transposes matrices, which are row-major on the host.
SETTERS: dict[int, Callable[[int, Any], None]] = {
    GL.GL_FLOAT: GL.glUniform1f,
    GL.GL_SAMPLER_2D: GL.glUniform1i,
    GL.GL_SAMPLER_2D_SHADOW: GL.glUniform1i,
    GL.GL_FLOAT_VEC2: lambda location, value: GL.glUniform2fv(location, 1, value),
    GL.GL_FLOAT_VEC3: lambda location, value: GL.glUniform3fv(location, 1, value),
    GL.GL_FLOAT_VEC4: lambda location, value: GL.glUniform4fv(location, 1, value),
    GL.GL_FLOAT_MAT3: lambda location, value: GL.glUniformMatrix3fv(location, 1, GL.GL_TRUE, value),
    GL.GL_FLOAT_MAT4: lambda location, value: GL.glUniformMatrix4fv(location, 1, GL.GL_TRUE, value),
}


def shader_text(name: str, defines: Defines) -> str:
    """Return a shader's source with its includes pasted and its defines after the version line."""
    lines = []
    for line in (SHADERS / name).read_text(encoding="utf-8").splitlines():
        if line.startswith("#include"):
            lines += (SHADERS / line.split('"')[1]).read_text(encoding="utf-8").splitlines()
        else:
            lines.append(line)
    return "\n".join([lines[0], *(f"#define {key} {value}" for key, value in sorted(defines.items())), *lines[1:], ""])


def _compile(kind: int, name: str, defines: Defines) -> int:
    shader: int = GL.glCreateShader(kind)
    GL.glShaderSource(shader, shader_text(name, defines))
    GL.glCompileShader(shader)
    if not GL.glGetShaderiv(shader, GL.GL_COMPILE_STATUS):
        log = GL.glGetShaderInfoLog(shader)
        raise InternalError(f"shader does not compile with {dict(defines)}: {_text(log)}", path=name)
    return shader


def _text(log: str | bytes) -> str:
    return log.decode(errors="replace") if isinstance(log, bytes) else log


class Program:
    """A linked vertex and fragment shader."""

    def __init__(self, vertex: str, fragment: str, defines: Defines) -> None:
        """Compile and link two files of ``shaders/``; raises InternalError with the compiler's log."""
        self._name = f"{vertex} + {fragment}"
        shaders = [
            _compile(kind, name, defines)
            for kind, name in ((GL.GL_VERTEX_SHADER, vertex), (GL.GL_FRAGMENT_SHADER, fragment))
        ]
        self._id = GL.glCreateProgram()
        for shader in shaders:
            GL.glAttachShader(self._id, shader)
        GL.glLinkProgram(self._id)
        for shader in shaders:
            GL.glDeleteShader(shader)
        if not GL.glGetProgramiv(self._id, GL.GL_LINK_STATUS):
            raise InternalError(f"shaders do not link: {_text(GL.glGetProgramInfoLog(self._id))}", path=self._name)
        self._slots = self._active_uniforms()
        self._held: dict[str, Any] = {}

    def _active_uniforms(self) -> list[tuple[str, int, Callable[[int, Any], None]]]:
        slots = []
        for index in range(GL.glGetProgramiv(self._id, GL.GL_ACTIVE_UNIFORMS)):
            name, _, kind = GL.glGetActiveUniform(self._id, index)
            called = _text(bytes(name)).rstrip("\0")  # bytes, or an array of them, by the version of PyOpenGL
            slots.append((called, GL.glGetUniformLocation(self._id, called), SETTERS[kind]))
        return slots

    def bind(self, *layers: Uniforms) -> None:
        """Use the program with each uniform from the first layer that has it; raises InternalError if none has.

        Does not send a value again if it is the same object as last time.
        """
        GL.glUseProgram(self._id)
        for name, location, setter in self._slots:
            value = next((layer[name] for layer in layers if name in layer), None)
            if value is None:
                raise InternalError(f"uniform {name} has no value", path=self._name)
            if self._held.get(name) is not value:
                setter(location, value)
                self._held[name] = value

    def delete(self) -> None:
        """Free the program."""
        GL.glDeleteProgram(self._id)


class ProgramShelf:
    """Programs compiled on first use, one for each set of defines."""

    def __init__(self) -> None:
        """Begin without programs."""
        self._programs: dict[tuple[str, str, frozenset[tuple[str, int]]], Program] = {}

    def get(self, vertex: str, fragment: str, defines: Defines) -> Program:
        """Return the program of two shader files and their defines."""
        key = (vertex, fragment, frozenset(defines.items()))
        if key not in self._programs:
            self._programs[key] = Program(vertex, fragment, defines)
        return self._programs[key]

    def delete(self) -> None:
        """Free all programs."""
        for program in self._programs.values():
            program.delete()
        self._programs.clear()
