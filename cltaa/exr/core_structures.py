"""Structures of OpenEXRCore: names and order of their members are those of its headers.

openexr_coding.h, openexr_chunkio.h and openexr_decode.h of 3.5.
"""

from __future__ import annotations

from ctypes import (
    POINTER,
    Structure,
    c_char_p,
    c_int,
    c_int8,
    c_int16,
    c_int32,
    c_size_t,
    c_uint8,
    c_uint16,
    c_uint64,
    c_void_p,
)

OWN_BYTES = 432  # of a pipeline, behind what is looked at here: 528 in all, by openexr_decode.h of 3.5


class Channel(Structure):
    """A channel of a chunk, and where its numbers go."""

    _fields_ = (
        ("channel_name", c_char_p),
        ("height", c_int32),
        ("width", c_int32),
        ("x_samples", c_int32),
        ("y_samples", c_int32),
        ("p_linear", c_uint8),
        ("bytes_per_element", c_int8),
        ("data_type", c_uint16),
        ("user_bytes_per_element", c_int16),
        ("user_data_type", c_uint16),
        ("user_pixel_stride", c_int32),
        ("user_line_stride", c_int32),
        ("decode_to_ptr", c_void_p),
    )


class Chunk(Structure):
    """Scan lines or a tile, counted in tiles."""

    _fields_ = (
        ("idx", c_int32),
        ("start_x", c_int32),
        ("start_y", c_int32),
        ("height", c_int32),
        ("width", c_int32),
        ("level_x", c_uint8),
        ("level_y", c_uint8),
        ("type", c_uint8),
        ("compression", c_uint8),
        ("sizes", c_uint64 * 5),
    )


class Pipeline(Structure):
    """What decodes one chunk after another."""

    _fields_ = (
        ("pipe_size", c_size_t),
        ("channels", POINTER(Channel)),
        ("channel_count", c_int16),
        ("decode_flags", c_uint16),
        ("part_index", c_int),
        ("context", c_void_p),
        ("chunk", Chunk),
        ("others", c_uint8 * OWN_BYTES),
    )
