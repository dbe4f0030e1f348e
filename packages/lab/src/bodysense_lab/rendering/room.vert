#version 330
uniform mat4 camera;
uniform mat4 light;
in vec3 position;
in vec3 normal;
in vec3 color;
in float pattern;
out vec3 world_position;
out vec3 world_normal;
out vec3 paint;
out float texture_kind;
out vec4 light_position;
void main() {
    world_position = position;
    world_normal = normal;
    paint = color;
    texture_kind = pattern;
    light_position = light * vec4(position, 1.0);
    gl_Position = camera * vec4(position, 1.0);
}
