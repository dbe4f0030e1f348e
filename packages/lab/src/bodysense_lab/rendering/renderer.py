"""Off-screen OpenGL renderer of a scene. Mesa's software renderer is enough without a graphics card."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.keypoints import Camera
from bodysense.body.pose import Pose
from bodysense.errors import BodysenseError, how_to_install
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense_lab.rendering.character import Character, load_figure
from bodysense_lab.rendering.scene import Scene

if TYPE_CHECKING:
    import moderngl

_NEAR, _FAR = 0.1, 60.0  # m
_SHADOW = 1024  # cells of a side of the shadow map
_SHADOW_REACH = 1.25  # m, half the side of the shadow map, around the body
_SAMPLES = 4  # samples per pixel
_HALF = np.pi / 2
_CUBE_SIDES = quaternion_exp(  # (6, 4) wxyz: turns of its front
    np.array([(0, 0, 0), (0, _HALF, 0), (0, np.pi, 0), (0, -_HALF, 0), (_HALF, 0, 0), (-_HALF, 0, 0)], dtype=float)
)
_CUBE = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, -1, 1], [1, 1, 1], [-1, 1, 1]], np.float32) / 2


class Renderer:
    """Renderer of one scene. Create it with `open_renderer`, which also closes it.

    The wall of the room faces the first camera.
    """

    def __init__(
        self, context: moderngl.Context, scene: Scene, camera: Camera, height: int, around: np.ndarray
    ) -> None:
        self.figure: Character = load_figure(scene.figure)
        self._context, self._scene, self._around = context, scene, np.array([around[0], 0.0, around[2]])
        self.size = size = (2 * round(height * float(camera.aspect) / 2), height)  # pixels, width and height
        self._body_program = _program(context, "body.vert", "noise.frag", "shadow.frag", "light.frag", "body.frag")
        self._room_program = _program(context, "room.vert", "noise.frag", "shadow.frag", "light.frag", "room.frag")
        self._paste_program = _program(context, "room.vert", "shadow.frag", "paste.frag")
        self._depth_program = _program(context, "depth.vert", "depth.frag")
        self._samples = context.framebuffer(
            [context.renderbuffer(size, 3, samples=_SAMPLES)], context.depth_renderbuffer(size, samples=_SAMPLES)
        )
        self._picture = context.framebuffer([context.renderbuffer(size, 3)])
        self._shadow = context.depth_texture((_SHADOW, _SHADOW))
        self._shadow.compare_func = "<="
        self._shadow_buffer = context.framebuffer(depth_attachment=self._shadow)
        self._frame = 0
        # The room is turned so that its wall faces the camera.
        turn = quaternion_exp(np.array([0.0, np.arctan2(camera.axes[0, 2], camera.axes[2, 2]), 0.0]))
        toward = np.array([quaternion_rotate(turn, lamp.toward) for lamp in scene.lamps])
        light = _orthographic(self._around + np.array([0.0, 0.95, 0.0]), toward[0], _SHADOW_REACH)
        for program in (self._body_program, self._room_program, self._paste_program, self._depth_program):
            _assign(program, light=_bytes(light))
            _set_lamps(program, scene, toward)
        self._make_body()
        self._make_room(turn)
        self.point(camera)

    def point(self, camera: Camera) -> None:
        """Set another camera; the size of pictures does not change."""
        for program in (self._body_program, self._room_program, self._paste_program, self._depth_program):
            _assign(program, camera=_bytes(_projection(camera)), eye=tuple(camera.position.tolist()))
        self._draw_room()

    def _make_body(self) -> None:
        figure, context = self.figure, self._context
        self._moving = context.buffer(reserve=len(figure.vertices) * 24)
        still = np.concatenate([figure.vertices, figure.part[:, None]], axis=1).astype(np.float32)
        buffers = [
            (self._moving, "3f 3f", "position", "normal"),
            (context.buffer(still.tobytes()), "3f 1f", "rest", "part"),
        ]
        index = context.buffer(figure.triangles.astype(np.int32).tobytes())
        self._body = context.vertex_array(self._body_program, buffers, index)
        self._body_shadow = context.vertex_array(self._depth_program, [(self._moving, "3f 12x", "position")], index)
        rest = dict(zip(figure.skeleton.points, figure.rest, strict=True))
        clothes = self._scene.clothes
        stops = [rest[f"left_{name}"][0] for name in ("shoulder", "elbow", "wrist")]
        _assign(
            self._body_program,
            skin=self._scene.skin,
            hair=self._scene.hair,
            shirt=clothes.shirt,
            trousers=clothes.trousers,
            shoes=clothes.shoes,
            stripes=clothes.stripes,
            left_eye=tuple(figure.eye.tolist()),
            sleeve_end=float(np.interp(clothes.sleeve, [0, 1, 2], stops)),
            neckline=float(rest["neck"][1]) + 0.05 - clothes.collar,
            shirt_end=float(rest["left_hip"][1]) + 0.02,
            shoe_top=float(rest["left_ankle"][1]) + 0.02,
        )

    def _make_room(self, turn: np.ndarray) -> None:
        """Create the room, rotated by a quaternion (4,)."""
        buffer = self._context.buffer(_room(self._scene, self._around, turn).astype(np.float32).tobytes())
        layout = (buffer, "3f 3f 3f 1f", "position", "normal", "color", "pattern")
        self._lit_room = self._context.vertex_array(self._room_program, [layout])
        self._room = self._context.vertex_array(self._paste_program, [layout], skip_errors=True)
        textures = {name: self._context.texture(self.size, 3) for name in ("dark", "bright")}
        self._still = {name: (texture, self._context.framebuffer([texture])) for name, texture in textures.items()}

    def _draw_room(self) -> None:
        """Draw the room for one camera, with and without the first lamp."""
        import moderngl

        self._context.enable_only(moderngl.DEPTH_TEST)
        self._shadow.use(0)
        for place, (name, (texture, picture)) in enumerate(self._still.items()):
            self._shadow_buffer.clear(depth=float(place))  # 0: everything is in shadow; 1: nothing
            self._samples.use()
            self._samples.clear(0.0, 0.0, 0.0, depth=1.0)
            self._lit_room.render()
            self._context.copy_framebuffer(picture, self._samples)
            texture.use(1 + place)
            _assign(self._paste_program, **{name: 1 + place})

    def draw(self, pose: Pose) -> np.ndarray:
        """Draw the body in one pose of its character's skeleton; returns pixels (H, W, 3), uint8."""
        import moderngl

        vertices, normals = self.figure.skin(pose)
        self._moving.write(np.hstack([vertices, normals]).tobytes())
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._shadow_buffer.use()
        self._shadow_buffer.clear(depth=1.0)
        self._body_shadow.render()
        self._samples.use()
        self._samples.clear(0.0, 0.0, 0.0, depth=1.0)
        for program in (self._body_program, self._paste_program):
            _assign(program, frame=float(self._frame % 997))
        self._context.enable(moderngl.CULL_FACE)
        self._body.render()
        self._context.disable(moderngl.CULL_FACE)
        self._room.render()
        self._context.copy_framebuffer(self._picture, self._samples)
        self._frame += 1
        width, height = self.size
        pixels = np.frombuffer(self._picture.read(components=3, alignment=1), np.uint8)
        return pixels.reshape(height, width, 3)[::-1].copy()


@contextmanager
def open_renderer(scene: Scene, camera: Camera, height: int, around: np.ndarray) -> Iterator[Renderer]:
    """Open a renderer of a scene for pictures `height` pixels high; the body is near `around` (3,) m, world.

    Raises BodysenseError if moderngl or OpenGL is missing.
    """
    try:
        import moderngl
    except ImportError:
        raise BodysenseError(f"drawing videos needs moderngl; {how_to_install('packages/lab[render]')}") from None
    try:
        context = moderngl.create_context(standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # moderngl raises plain Exception
        raise BodysenseError(
            f"no OpenGL 3.3 off screen ({error}); install Mesa's libegl1 and libgl1-mesa-dri"
        ) from None
    try:
        yield Renderer(context, scene, camera, height, around)
    finally:
        context.release()


def _program(context: moderngl.Context, vertex: str, *fragment: str) -> moderngl.Program:
    """Compile a vertex shader, and a fragment shader from several files."""
    head = "#version 330\nin vec3 world_position;\n"
    return context.program(vertex_shader=_text(vertex), fragment_shader=head + "".join(map(_text, fragment)))


def _text(name: str) -> str:
    return files("bodysense_lab.rendering").joinpath(name).read_text(encoding="utf-8")


def _assign(program: moderngl.Program, **uniforms: object) -> None:
    """Set uniforms; those that the program does not use are ignored, because the compiler drops them."""
    for name, value in uniforms.items():
        if name in program:
            if isinstance(value, bytes):
                program[name].write(value)  # type: ignore[union-attr]
            else:
                program[name].value = value  # type: ignore[union-attr]


def _set_lamps(program: moderngl.Program, scene: Scene, toward: np.ndarray) -> None:
    _assign(
        program,
        lamp_toward=toward.astype(np.float32).tobytes(),
        lamp_color=np.array([lamp.color for lamp in scene.lamps], np.float32).tobytes(),
        sky=tuple(scene.sky.tolist()),
        shadow=0,
        shadow_texel=1.0 / _SHADOW,
        grain=scene.noise,
    )


def _room(scene: Scene, around: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return the corners (6 N, 10) of the room's triangles: position, normal, colour and pattern."""
    back = -scene.wall_distance
    a, b, c, d = (np.array([x, y, z]) for x, y, z in ((-30, 0, back), (30, 0, back), (30, 12, back), (-30, 12, back)))
    e, f = np.array([-30, 0, 9]), np.array([30, 0, 9])
    rows = [(np.array([a, b, c, a, c, d]), [0, 0, 1], scene.wall, 1.0)]
    rows += [(np.array([e, f, b, e, b, a]), [0, 1, 0], scene.floor, 2.0)]
    for box in scene.furniture:
        own, depth = quaternion_exp(np.array([0.0, box.turn, 0.0])), float(np.hypot(*box.size[[0, 2]])) / 2
        middle = np.array([*box.middle[:2], max(box.middle[2], back + depth)])  # in front of the wall
        for side in _CUBE_SIDES:
            place = quaternion_rotate(own, quaternion_rotate(side, _CUBE.astype(float)) * box.size) + middle
            normal = quaternion_rotate(own, quaternion_rotate(side, np.array([0.0, 0.0, 1.0])))
            rows.append((place, normal, box.color, 0.0))
    parts = []
    for place, normal, color, pattern in rows:
        turned, facing = quaternion_rotate(turn, place) + around, quaternion_rotate(turn, np.array(normal, float))
        parts.append(np.hstack([turned, np.tile([*facing, *color, pattern], (len(place), 1))]))
    return np.concatenate(parts)


def _projection(camera: Camera) -> np.ndarray:
    """Return the matrix (4, 4) from world to clip coordinates."""
    focal = 2 * float(camera.focal)
    lens = np.zeros((4, 4))
    lens[0, 0], lens[1, 1] = focal / float(camera.aspect), focal
    lens[2, 2], lens[2, 3] = -(_FAR + _NEAR) / (_FAR - _NEAR), -2 * _FAR * _NEAR / (_FAR - _NEAR)
    lens[3, 2] = -1.0
    return lens @ _world_to_axes(camera.axes, camera.position)


def _orthographic(middle: np.ndarray, toward: np.ndarray, reach: float) -> np.ndarray:
    """Return the matrix (4, 4) from world to clip coordinates of a distant lamp, centred at `middle`."""
    right = np.cross([0.0, 1.0, 0.0], toward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(toward, right), toward], axis=1)
    return np.diag([1 / reach, 1 / reach, -1 / reach, 1.0]) @ _world_to_axes(axes, middle)


def _world_to_axes(axes: np.ndarray, position: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes.T, -axes.T @ position
    return matrix


def _bytes(matrix: np.ndarray) -> bytes:
    return matrix.T.astype(np.float32).tobytes()
